// SPDX-License-Identifier: Apache-2.0
// Checks of views that all backends share.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "stgs/format/camera.h"
#include "stgs/format/math/colour.h"
#include "stgs/format/scene_file.h"
#include "stgs/player/renderer.h"

namespace stgs::player {

// Returns how the colours of a scene are encoded (math/colour.h).
inline int encoding_of(const SceneMetadata& metadata) {
  return math::colour_encoding(metadata.primaries, metadata.transfer);
}

// Returns kUsage for too few or too many views, or if the size or fovea of a view is invalid.
inline Status check_views(const std::vector<View>& views) {
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
  return {};
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
