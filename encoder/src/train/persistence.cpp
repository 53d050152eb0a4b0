// SPDX-License-Identifier: Apache-2.0
#include "train/persistence.h"

#include <algorithm>
#include <cmath>

#include "stgs/encoder/frame_memory.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

// Minimum of l(t) at both ends of the window.
constexpr float kMinVisibility = 0.7f;
// Maximum displacement within the window, in mean standard deviations.
constexpr float kMaxDisplacement = 0.5f;
// Minimum number of updates, as a fraction of the iterations so far.
constexpr double kMinUpdates = 0.01;
constexpr double kMaxOpacity = 0.9999;
// Minimum opacity in the last frame of a moving primitive that the next window starts from.
constexpr float kMinCarriedOpacity = 0.05f;
// Sigma of such a primitive, frames: it covers the first part of the window, until points of the
// window itself do.
constexpr float kCarriedSigma = 8;
// Sigma of a persistent primitive, frames: if it ends, it is not visible a frame later.
constexpr float kEndSigma = 0.25f;
constexpr int kEndMargin = 8;  // frames before a window at which an ending primitive begins

float visibility_at(const Gaussians4D& set, std::size_t i, float ticks) {
  return math::visibility(ticks - set.time[i], set.sigma[i], set.radius[i]);
}

}  // namespace

std::vector<std::uint32_t> list_persistent(const TrainState& state, int frames, int first) {
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
      const bool stays = std::min(visibility_at(set, i, static_cast<float>(first)),
                                  visibility_at(set, i, last)) >= kMinVisibility &&
                         moved <= kMaxDisplacement * size;
      if (!stays || state.updates[i] < min_updates) continue;
    }
    out.push_back(static_cast<std::uint32_t>(i));
  }
  return out;
}

std::vector<std::uint32_t> list_still(const PreparedCapture& capture, const Gaussians4D& set,
                                      const std::vector<std::uint32_t>& primitives) {
  struct View {
    math::PinholeCamera camera;
    FrameMemory::ImagePtr still;
  };
  std::vector<View> views;
  for (const Camera& camera : capture.training_cameras()) {
    const FrameMemory::ImagePtr still =
        capture.memory ? capture.memory->still(camera.name) : nullptr;
    if (still) views.push_back({camera.pinhole(capture.near_plane), still});
  }
  if (views.empty()) return primitives;
  std::vector<std::uint8_t> is_still(primitives.size());
  parallel_for(std::size_t{0}, primitives.size(), [&](std::size_t k) {
    const std::uint32_t i = primitives[k];
    const math::Vec3 position{set.position[3 * i], set.position[3 * i + 1],
                              set.position[3 * i + 2]};
    int seen = 0, still = 0;
    for (const View& view : views) {
      const math::Vec3 c = math::to_camera(view.camera, position);
      if (c.z <= capture.near_plane) continue;
      const float u = view.camera.fx * c.x / c.z + view.camera.cx;
      const float v = view.camera.fy * c.y / c.z + view.camera.cy;
      if (!(u >= 0 && v >= 0 && u < view.camera.width && v < view.camera.height)) continue;
      ++seen;
      const auto pixel = static_cast<std::size_t>(v) * static_cast<std::size_t>(view.still->width) +
                         static_cast<std::size_t>(u);
      still += view.still->data[pixel] >= kMinMask ? 1 : 0;
    }
    is_still[k] = seen > 0 && 2 * still >= seen ? 1 : 0;
  });
  std::vector<std::uint32_t> out;
  for (std::size_t k = 0; k < primitives.size(); ++k)
    if (is_still[k] != 0) out.push_back(primitives[k]);
  return out;
}

TrainState persistent_state(const TrainState& trained, const std::vector<std::uint32_t>& persistent,
                            const std::vector<std::uint32_t>& carried,
                            const std::vector<std::uint32_t>& stored, int frames) {
  TrainState out = trained.without_primitives();
  out.resize(persistent.size() + carried.size());
  parallel_blocks(std::size_t{0}, out.size(), kPrimitivesPerTask / 4,
                  [&](std::size_t begin, std::size_t end) {
                    for (std::size_t k = begin; k < end; ++k) {
                      const bool stays = k < persistent.size();
                      const std::size_t i = stays ? persistent[k] : carried[k - persistent.size()];
                      out.copy_parameters(trained, i, i + 1, k);
                      if (!stays) carry(out, k, frames);
                    }
                  });
  for (std::size_t k = 0; k < persistent.size(); ++k) {
    const std::uint32_t i = persistent[k];
    if (trained.is_fixed(i) || std::binary_search(stored.begin(), stored.end(), i))
      out.updates[k] = kFixed;
  }
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

std::vector<std::uint32_t> list_carried(const TrainState& state, int frames,
                                        const std::vector<std::uint32_t>& persistent) {
  std::vector<std::uint32_t> out;
  if (state.is_coupled()) return out;
  const auto last = static_cast<float>(frames - 1);
  for (std::size_t i = 0; i < state.size(); ++i) {
    const auto index = static_cast<std::uint32_t>(i);
    if (state.is_fixed(i) || std::binary_search(persistent.begin(), persistent.end(), index))
      continue;
    const float opacity =
        math::opacity_of(state.set.opacity_logit[i]) * visibility_at(state.set, i, last);
    if (opacity >= kMinCarriedOpacity) out.push_back(index);
  }
  return out;
}

void carry(TrainState& state, std::size_t i, int frames) {
  Gaussians4D& set = state.set;
  for (std::size_t c = 0; c < 3; ++c)
    set.position[3 * i + c] += set.velocity[3 * i + c] * (static_cast<float>(frames) - set.time[i]);
  set.time[i] = 0;
  set.radius[i] = 0;
  set.sigma[i] = kCarriedSigma;
  state.log_sigma[i] = std::log(kCarriedSigma);
  const float f = math::lifespan_modulation(kCarriedSigma, set.radius[i]);
  for (std::size_t c = 0; c < 3; ++c) state.velocity[3 * i + c] = f * set.velocity[3 * i + c];
}

void persist(TrainState& state, std::size_t i, int first, int frames) {
  Gaussians4D& set = state.set;
  double visible = 0;
  for (int f = first; f < frames; ++f) visible += visibility_at(set, i, static_cast<float>(f));
  const double opacity =
      std::min(math::opacity_of(set.opacity_logit[i]) * visible / (frames - first), kMaxOpacity);
  set.opacity_logit[i] = static_cast<float>(std::log(opacity / (1.0 - opacity)));
  const float middle = 0.5f * static_cast<float>(frames - 1);
  for (std::size_t c = 0; c < 3; ++c) {
    set.position[3 * i + c] += set.velocity[3 * i + c] * (middle - set.time[i]);
    set.velocity[3 * i + c] = state.velocity[3 * i + c] = 0.0f;
  }
  set.time[i] = middle;
  set.radius[i] = kPersistentRadius;
  set.sigma[i] = kEndSigma;
  state.log_sigma[i] = std::log(kEndSigma);
}

void end_at(Gaussians4D& set, std::size_t i, int frame) {
  // From before the first frame, because cameras may be late, to the frame before.
  set.time[i] = 0.5f * static_cast<float>(frame - 1 - kEndMargin);
  set.radius[i] = 0.5f * static_cast<float>(frame - 1 + kEndMargin);
}

}  // namespace stgs::encoder
