// SPDX-License-Identifier: Apache-2.0
// The interface of a training backend: steps over one view, densification, and the importances at
// the end. Schedules, the timing of densification and checkpoints are the trainer's.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "math/camera_grad.h"
#include "math/damp.h"
#include "math/lens.h"
#include "math/short_lived.h"
#include "perceptual/feature_network.h"
#include "perceptual/patch.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/ranks.h"
#include "train/adam.h"
#include "train/densify.h"
#include "train/hyper_parameters.h"
#include "train/importance.h"
#include "train/random.h"
#include "train/train_state.h"
#include "train/training_image.h"

namespace stgs::encoder {

// A view of a multi-rank step, known to every rank.
struct BatchView {
  math::Vec3 centre;  // of the camera, world space
  float ticks = 0;
  std::size_t colour_index = 0;
};

struct StepInput {
  math::PinholeCamera camera;
  float ticks = 0;                 // time, frames
  TrainingImage ground_truth;      // of the camera's size
  math::Lens lens{0, 0};           // undone in the ground truth before the losses
  std::size_t colour_index = 0;    // of the colour correction to use
  math::Vec3 background{0, 0, 0};  // sRGB-encoded
  // Whether the background is a colour of the image after the colour map, as in foreground
  // training.
  bool background_is_mapped = false;
  // Fraction of the primitives that the step drops, and their selection (see dropped()).
  float drop_share = 0;
  Random drop_random{0, 0, RandomPurpose::kDrop};
  int sh_degree = 0;                       // SH degree in use
  int kernel = 0;                          // of the splats
  bool modulated = true;                   // false: f = 1
  math::DampingRules damping{};            // ignored by a coupled state
  math::ShortLivedRules short_lived{};     // apply to `rates` and `rate_sh0`
  bool learn_radius = true;                // false: r is constant
  bool second_stage = false;               // L_opacity is on
  bool gather_statistics = false;          // for densification
  bool gather_camera = false;              // compute StepOutput::camera and ::vignetting
  std::array<float, kAttributes> rates{};  // learning rates; kSh: of SH degrees above 0
  float rate_sh0 = 0;
  AdamBetas betas;  // of the primitives; differ from Adam's defaults only with a batch
  float rate_colour = 0;
  float weight_l1 = 0, weight_ssim = 0;
  float weight_lifespan = 0, weight_opacity = 0, weight_scale = 0;
  float weight_normal = 0;      // 0: L_n is off, at no cost; must be 0 for a coupled state
  float weight_perceptual = 0;  // > 0 requires a network in the plan
  float weight_rate = 0;        // loss per bit; > 0 requires a state that is being rounded
  Patch patch;                  // evaluated by the perceptual loss
  // For a step of several ranks, the views of all ranks in rank order, including this one.
  std::vector<BatchView> batch;
};

struct StepOutput {
  double loss = 0;                         // L_recon + L_reg
  double l1 = 0, mse = 0, ssim = 0;        // means over the image
  double normal = 0;                       // L_n before weighting; 0 if it is off
  double perceptual = 0;                   // L_lpips of the patch before weighting; 0 if it is off
  std::size_t visible = 0;                 // primitives rendered
  std::optional<math::CameraGrad> camera;  // gradient of L_recon, if it is gathered
  float vignetting = 0;                    // also: with respect to the vignetting of the lens
};

enum class DensifyStep { kGrow, kReplace, kRelocate };

struct DensifyInput {
  const HyperParameters* parameters = nullptr;
  DensifyContext context;
  DensifyStep step = DensifyStep::kGrow;
  bool reset_opacity = false;  // after the step
};

// Upper bounds of the requirements of a run, known before it starts.
struct TrainPlan {
  std::size_t primitives = 0;
  int sh_coefficients = 1;    // stored
  int width = 0, height = 0;  // of the largest image
  bool coupled = false;       // the ablation's representation (TrainState::is_coupled)
  bool normals = false;       // L_n is on in some steps
  bool rounding = false;      // some steps render rounded values
  std::shared_ptr<const FeatureNetwork> perceptual = nullptr;  // of the perceptual loss; null: off
  int perceptual_patch = 0;  // side of its patches, pixels; 0: complete images
};

// Call it from one thread; it uses many. The backend owns the state between begin() and
// synchronise().
//
// With several ranks, all make the same calls with the same values, except for the view of a step.
// A step is then one Adam step with the mean gradient of all views, for the primitives visible in
// any of them, and all states remain bit-identical.
class TrainBackend {
 public:
  virtual ~TrainBackend() = default;
  // Makes all further steps joint steps of the ranks (not owned). All ranks call it, before any
  // other function.
  virtual Status join(Ranks& ranks) = 0;
  // Checks that this backend can compute the perceptual loss. The error includes a remedy.
  virtual Status check_perceptual() const = 0;
  // Reserves memory for a run. The error of a run that does not fit, or that this backend cannot
  // train, states the required and the available memory and a remedy.
  virtual Status reserve(const TrainPlan& plan) = 0;
  // Starts working on a state, of which views render the rounded values if it has rounding rules
  // (CompactionState). It is not owned and must outlive the backend or the next begin().
  virtual Status begin(TrainState& state) = 0;
  // Starts a step, which may still be in flight on return; a later call may return its error. The
  // input shares ownership of its image as long as needed.
  virtual Status step(const StepInput& input) = 0;
  // Runs grow(), replace() or relocate(), and reset_opacity(), of train/densify.h and
  // train/relocation.h after the training steps so far. The
  // random numbers depend on the state's iteration, which the host updates.
  virtual Result<DensifyCounts> densify(const DensifyInput& input) = 0;
  // Raises scales below `pixels` to it, in pixels of the camera that samples the primitive most
  // densely among those that see it at its time T. After read(), not for a coupled state.
  virtual Status limit_scales(std::span<const math::PinholeCamera> cameras, float pixels) = 0;
  // Returns the current number of primitives.
  virtual std::size_t size() const = 0;
  // Waits for all steps and returns the outputs of those since the last read(), one per view: in
  // step order, and within a step in rank order.
  virtual Result<std::vector<StepOutput>> read() = 0;
  // Waits for all steps and writes their results to the state.
  virtual Status synchronise() = 0;
  // After an error of step() or read() with a single rank: discards the incomplete steps, which are
  // the last ones, and returns their number. The state is then that of the completed steps.
  virtual std::size_t abandon() = 0;
  // Computes view_importance() of the state passed to begin(); nullopt if `should_continue` returns
  // false. After synchronise(), a single rank may call begin() and importance() alone.
  virtual Result<std::optional<std::vector<float>>> importance(
      std::span<const ImportanceView> views,
      const std::function<bool(double)>& should_continue) = 0;
  // Returns the name of the backend and its device, for example "cpu (AVX2)".
  virtual std::string name() const = 0;
};

// Creates the CPU backend.
std::unique_ptr<TrainBackend> make_cpu_backend();
// Creates the CUDA backend on GPU number `gpu` modulo the number of GPUs. kUnsupported if there is
// none, kNotBuilt in a build without CUDA. The error states the reason, but no alternative.
Result<std::unique_ptr<TrainBackend>> make_cuda_backend(int gpu = 0);
// Creates a backend by name: "cpu", "cuda", or "auto", which is CUDA if the build and the machine
// support it, else the CPU with the reason logged. `gpu`: as make_cuda_backend(), of a process that
// trains alone. `ranks` is not owned and must outlive the backend; null: this process trains alone.
// Otherwise each rank creates a backend of the same kind, and they are joined.
Result<std::unique_ptr<TrainBackend>> make_backend(const std::string& name, int gpu,
                                                   const LogSink& log = nullptr,
                                                   Ranks* ranks = nullptr);

}  // namespace stgs::encoder
