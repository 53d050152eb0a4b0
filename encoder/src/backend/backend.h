// SPDX-License-Identifier: Apache-2.0
// What a training backend does: a step over one view, and weighing the primitives at the end.
// Everything that decides (schedules, densification, checkpoints) stays with the trainer.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "math/damp.h"
#include "perceptual/patch.h"
#include "perceptual/vgg16.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/ranks.h"
#include "train/adam.h"
#include "train/densify.h"
#include "train/hyper_parameters.h"
#include "train/importance.h"
#include "train/picture.h"
#include "train/random.h"
#include "train/train_state.h"

namespace stgs::encoder {

// What every rank knows of the view of each.
struct BatchView {
  math::Vec3 centre;  // of the camera, in the world
  float ticks = 0;
  std::size_t colour_index = 0;
};

struct StepInput {
  math::PinholeCamera camera;
  float ticks = 0;                 // moment, frames
  TrainingImage ground_truth;      // the camera's size
  std::size_t colour_index = 0;    // which colour correction
  math::Vec3 background{0, 0, 0};  // sRGB-encoded
  // Share of the primitives that are left out, and from what they are drawn (dropped()).
  float drop_share = 0;
  Random drop_random{0, 0, RandomPurpose::kDrop};
  int sh_degree = 0;                       // harmonics in use
  bool modulated = true;                   // false: f = 1
  math::DampingRules damping{};            // not where it is coupled
  bool learn_radius = true;                // false: r stays as it is
  bool second_stage = false;               // L_opacity is on
  bool gather_statistics = false;          // for densification
  std::array<float, kAttributes> rates{};  // learning rates; kSh: of the harmonics above degree 0
  float rate_sh0 = 0;
  AdamBetas betas;  // of the primitives; others than Adam's own only where there is a batch
  float rate_colour = 0;
  float weight_l1 = 0, weight_ssim = 0;
  float weight_lifespan = 0, weight_opacity = 0, weight_scale = 0;
  float weight_normal = 0;      // 0: L_n is off, and costs nothing; no coupled state has it
  float weight_perceptual = 0;  // > 0 only where the plan has a network
  Patch patch;                  // what the perceptual loss looks at
  // Where several ranks take the step together, the views of all in their order; this is one.
  std::vector<BatchView> batch;
};

struct StepOutput {
  double loss = 0;          // L_recon + L_reg
  double l1 = 0, ssim = 0;  // means over the picture
  double normal = 0;        // L_n before its weight; 0 where it is off
  double perceptual = 0;    // L_lpips of the patch before its weight; 0 where it is off
  std::size_t visible = 0;  // primitives drawn
};

struct DensifyInput {
  const HyperParameters* parameters = nullptr;
  DensifyContext context;
  bool refining = false;       // replace() of the second stage instead of grow()
  bool reset_opacity = false;  // afterwards
};

// What a run will need at most, told before it starts.
struct TrainPlan {
  std::size_t primitives = 0;
  int sh_coefficients = 1;    // stored
  int width = 0, height = 0;  // of the largest picture
  bool coupled = false;       // the ablation's representation (TrainState::is_coupled)
  bool normals = false;       // some steps have L_n on
  std::shared_ptr<const Vgg16> perceptual = nullptr;  // of the perceptual loss; null: there is none
  int perceptual_patch = 0;  // pixels a side of its patches; 0: whole pictures
};

// One thread calls it; it uses many. Several ranks make the same calls with the same values, but
// for the view of a step: then a step is one of Adam with the mean gradient of all views, for the
// primitives that any of them sees, and all states stay the same to the bit. The state is the
// backend's between begin and synchronise.
class TrainBackend {
 public:
  virtual ~TrainBackend() = default;
  // Takes steps together with other ranks (not owned) from now on; before all else, by all of them.
  virtual Status join(Ranks& ranks) = 0;
  // Whether steps can have a perceptual loss here; else what to do.
  virtual Status check_perceptual() const = 0;
  // Refuses a run that does not fit in memory, and what it cannot train: what it needs, what there
  // is, what to do.
  virtual Status reserve(const TrainPlan& plan) = 0;
  // Works on this state from now on (not owned; outlives the backend or the next begin).
  virtual Status begin(TrainState& state) = 0;
  // Starts a step. It may still be under way when this returns, and its error may be told by a
  // later call; the input holds its picture for as long as that is needed.
  virtual Status step(const StepInput& input) = 0;
  // grow() or replace(), and reset_opacity(), of train/densify.h after the steps so far. The random
  // numbers are of the state's iteration, which is the host's.
  virtual Result<DensifyCounts> densify(const DensifyInput& input) = 0;
  // Primitives that there are now.
  virtual std::size_t size() const = 0;
  // What the views of the steps since the last read() gave, in the order of the steps, within a
  // step in that of the ranks; waits for them.
  virtual Result<std::vector<StepOutput>> read() = 0;
  // After this the state holds everything that the steps have done.
  virtual Status synchronise() = 0;
  // After an error of step() or read(), where there is one rank: forgets the steps that are not
  // done, the last ones, and returns their number. The state is then that of the steps before.
  virtual std::size_t abandon() = 0;
  // view_importance() of the state that begin() took; nothing where `go_on` answers false. Of
  // several ranks one alone may call both, after synchronise().
  virtual Result<std::optional<std::vector<float>>> importance(
      std::span<const ImportanceView> views, const std::function<bool(double)>& go_on) = 0;
  virtual std::string name() const = 0;
};

std::unique_ptr<TrainBackend> make_cpu_backend();
// GPU number `gpu` modulo how many there are; kUnsupported where there is none, kNotBuilt in a
// build without CUDA. The error says why, not what to do instead.
Result<std::unique_ptr<TrainBackend>> make_cuda_backend(int gpu = 0);
// "cpu", "cuda", or "auto": CUDA where this build and machine have it, else the CPU, and `log` is
// told why. `ranks` (not owned, outlives the backend; null: this process trains alone) make one
// each, of one kind, and are joined.
Result<std::unique_ptr<TrainBackend>> make_backend(const std::string& name,
                                                   const LogSink& log = nullptr,
                                                   Ranks* ranks = nullptr);

}  // namespace stgs::encoder
