// SPDX-License-Identifier: Apache-2.0
// Checks of views that all backends share.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "stgs/format/camera.h"
#include "stgs/format/math/colour.h"
#include "stgs/format/scene_file.h"
#include "stgs/player/renderer.h"
#include "stgs/player/timeline.h"

namespace stgs::player {

// How the primitives of a scene become pixels.
struct Appearance {
  int encoding = 0;  // of the colours (math/colour.h)
  int kernel = 0;    // of the splats
};

inline Appearance appearance_of(const SceneMetadata& metadata) {
  return {math::colour_encoding(metadata.primaries, metadata.transfer), metadata.kernel};
}

// Returns the memory of the images of a frame, bytes: colour, alpha and depth of all views, and
// transmittance, last splat and tile lists of the largest one while the CPU renders it.
inline std::uint64_t frame_memory(const std::vector<View>& views) {
  constexpr std::uint64_t kBytesPerPixel = 20, kBytesOfLargest = 9;
  std::uint64_t all = 0, largest = 0;
  for (const View& view : views) {
    const auto pixels = static_cast<std::uint64_t>(double{view.camera.width} * view.camera.height);
    all += pixels;
    largest = std::max(largest, pixels);
  }
  return all * kBytesPerPixel + largest * kBytesOfLargest;
}

// Returns kUsage for too few or too many views, or if the size or fovea of a view is invalid, and
// kLimit if their images exceed the memory that renderers of the timeline may take: the size may
// come from a file.
inline Status check_views(const std::vector<View>& views, const Timeline& timeline) {
  if (views.empty() || views.size() > kMaxViews) {
    return usage_error("a call renders 1 to {} views, got {}", kMaxViews, views.size());
  }
  for (const View& view : views) {
    const auto is_valid_side = [](float v) { return v >= 1 && v <= kMaxImageSide; };
    if (!is_valid_side(view.camera.width) || !is_valid_side(view.camera.height)) {
      return usage_error("a view of {}x{} pixels cannot be rendered; each side must be 1 to {}",
                         view.camera.width, view.camera.height, kMaxImageSide);
    }
    if (view.fovea && !(view.fovea->radius >= 0 && std::isfinite(view.fovea->centre.x) &&
                        std::isfinite(view.fovea->centre.y))) {
      return usage_error(
          "the fovea of a view must have a finite centre and a radius of 0 or more, in pixels");
    }
  }
  const std::uint64_t limit = timeline.budget()->usage(Budget::Pool::kRenderer).limit;
  const std::uint64_t bytes = frame_memory(views);
  if (bytes <= limit) return {};
  return {
      StatusCode::kLimit,
      fmt::format("{}: an image of {}x{} pixels needs too much memory (limit {} bytes, need {}); "
                  "render fewer pixels or raise memory_budget",
                  timeline.name(), views[0].camera.width, views[0].camera.height, limit, bytes)};
}

// Returns the fovea of a view, limited to coordinates at which floats can distinguish squares. If
// the view has none, returns one that covers any image.
inline Fovea fovea_of(const View& view) {
  static constexpr float kMaxDistance = 1e6f, kMaxRadius = 1e7f;  // pixels
  if (!view.fovea) return {{0.0f, 0.0f}, kMaxRadius};
  const auto limited = [](float x) { return std::clamp(x, -kMaxDistance, kMaxDistance); };
  const Fovea& fovea = *view.fovea;
  return {{limited(fovea.centre.x), limited(fovea.centre.y)}, std::min(fovea.radius, kMaxRadius)};
}

}  // namespace stgs::player
