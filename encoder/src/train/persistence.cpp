// SPDX-License-Identifier: Apache-2.0
#include "train/persistence.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs::encoder {
namespace {

// Minimum of l(t) at both ends of the window.
constexpr float kMinVisibility = 0.7f;
// Maximum displacement within the window, in mean standard deviations.
constexpr float kMaxDisplacement = 0.5f;
// Minimum number of updates, as a fraction of the iterations so far.
constexpr double kMinUpdates = 0.01;
constexpr double kMaxOpacity = 0.9999;

float visibility_at(const Gaussians4D& set, std::size_t i, float ticks) {
  return math::visibility(ticks - set.time[i], set.sigma[i], set.radius[i]);
}

}  // namespace

std::vector<std::uint32_t> list_persistent(const TrainState& state, int frames) {
  std::vector<std::uint32_t> out;
  if (state.is_coupled()) return out;
  const Gaussians4D& set = state.set;
  const auto last = static_cast<float>(frames - 1);
  const double min_updates = kMinUpdates * static_cast<double>(state.iteration);
  for (std::size_t i = 0; i < state.size(); ++i) {
    if (!state.is_fixed(i)) {
      const float* u = &set.velocity[3 * i];
      const float* s = &set.log_scale[3 * i];
      const float moved = std::hypot(u[0], u[1], u[2]) * last;
      const float size = std::exp((s[0] + s[1] + s[2]) / 3.0f);
      const bool stays =
          std::min(visibility_at(set, i, 0.0f), visibility_at(set, i, last)) >= kMinVisibility &&
          moved <= kMaxDisplacement * size;
      if (!stays || state.updates[i] < min_updates) continue;
    }
    out.push_back(static_cast<std::uint32_t>(i));
  }
  return out;
}

TrainState persistent_state(const TrainState& trained, const std::vector<std::uint32_t>& persistent,
                            bool store) {
  TrainState out = trained;
  out.compaction = {};
  out.retain(persistent);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const bool fixed = store || out.is_fixed(i);
    out.clear_moments(i);
    if (fixed) out.updates[i] = kFixed;
  }
  out.cameras_first.assign(out.cameras.size(), CameraCorrection{});
  out.cameras_second = out.camera_sums = out.cameras_first;
  out.camera_updates.assign(out.cameras.size(), 0);
  out.camera_views.assign(out.cameras.size(), 0);
  out.statistics.reset(out.size());
  out.iteration = 0;
  out.second_stage = out.opacity_resets = 0;
  out.seconds = out.mean_loss = 0;
  return out;
}

void split_window(const TrainState& state, const std::vector<std::uint32_t>& stored, Scene& scene) {
  std::vector<bool> is_stored(state.size(), false);
  for (const std::uint32_t i : stored) is_stored[i] = true;
  std::vector<std::uint32_t> order;
  for (std::size_t i = 0; i < state.size(); ++i) {
    if (!state.is_fixed(i) && !is_stored[i]) order.push_back(static_cast<std::uint32_t>(i));
  }
  const std::size_t moving = order.size();
  order.insert(order.end(), stored.begin(), stored.end());
  scene.gaussians = scene.gaussians.gather(order);
  if (!scene.importance.empty()) {
    std::vector<float> importance;
    for (const std::uint32_t i : order) importance.push_back(scene.importance[i]);
    scene.importance = std::move(importance);
  }
  const double frames = scene.metadata.frames;
  scene.parts = {{0, frames, moving}, {0, frames, stored.size()}};
}

void persist(TrainState& state, std::size_t i, int frames) {
  Gaussians4D& set = state.set;
  double visible = 0;
  for (int f = 0; f < frames; ++f) visible += visibility_at(set, i, static_cast<float>(f));
  const double opacity =
      std::min(math::opacity_of(set.opacity_logit[i]) * visible / frames, kMaxOpacity);
  set.opacity_logit[i] = static_cast<float>(std::log(opacity / (1.0 - opacity)));
  const float middle = 0.5f * static_cast<float>(frames - 1);
  for (std::size_t c = 0; c < 3; ++c) {
    set.position[3 * i + c] += set.velocity[3 * i + c] * (middle - set.time[i]);
    set.velocity[3 * i + c] = state.velocity[3 * i + c] = 0.0f;
  }
  set.time[i] = middle;
  set.radius[i] = kPersistentRadius;
  set.sigma[i] = 1.0f;
  state.log_sigma[i] = 0.0f;
}

}  // namespace stgs::encoder
