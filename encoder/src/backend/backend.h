// SPDX-License-Identifier: Apache-2.0
// What a training backend does: a step over one view. Everything that decides (schedules,
// densification, checkpoints) stays with the trainer.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>

#include "stgs/encoder/prepared_capture.h"
#include "train/train_state.h"

namespace stgs::encoder {

struct StepInput {
  math::PinholeCamera camera;
  float ticks = 0;                         // moment, frames
  const Image8* truth = nullptr;           // the camera's size
  std::size_t colour_index = 0;            // which colour correction
  int sh_degree = 0;                       // harmonics in use
  bool modulated = true;                   // false: f = 1
  bool learn_radius = true;                // false: r stays as it is
  bool second_stage = false;               // L_opacity is on
  bool gather_statistics = false;          // for densification
  std::array<float, kAttributes> rates{};  // learning rates; kSh: of the harmonics above degree 0
  float rate_sh0 = 0;
  float rate_colour = 0;
  float weight_l1 = 0, weight_ssim = 0;
  float weight_lifespan = 0, weight_opacity = 0, weight_scale = 0;
};

struct StepOutput {
  double loss = 0;          // L_recon + L_reg
  double l1 = 0, ssim = 0;  // means over the picture
  std::size_t visible = 0;  // primitives drawn
};

// One thread calls it; it uses many. The state is the backend's between begin and synchronise.
class TrainBackend {
 public:
  virtual ~TrainBackend() = default;
  // Works on this state from now on (not owned; outlives the backend or the next begin).
  virtual void begin(TrainState& state) = 0;
  virtual StepOutput step(const StepInput& input) = 0;
  // After this the state holds everything that the steps have done.
  virtual void synchronise() = 0;
  virtual std::string name() const = 0;
};

std::unique_ptr<TrainBackend> make_cpu_backend();

}  // namespace stgs::encoder
