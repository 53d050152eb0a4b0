// SPDX-License-Identifier: Apache-2.0
// What every backend asks of a call.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "stgs/format/camera.h"
#include "stgs/player/renderer.h"

namespace stgs::player {

// kUsage where there are too few or too many views, or one of a size that cannot be drawn.
inline Status check_views(const std::vector<View>& views) {
  if (views.empty() || views.size() > kMaxViews) {
    return usage_error("a call draws 1 to {} views, not {}", kMaxViews, views.size());
  }
  for (const View& view : views) {
    const auto side = [](float v) { return v >= 1 && v <= kMaxImageSide; };
    if (!side(view.camera.width) || !side(view.camera.height)) {
      return usage_error("a view of {}x{} pixels cannot be drawn; each side is 1 to {}",
                         view.camera.width, view.camera.height, kMaxImageSide);
    }
    if (view.fovea && !(view.fovea->radius >= 0 && std::isfinite(view.fovea->centre.x) &&
                        std::isfinite(view.fovea->centre.y))) {
      return usage_error("a view's fovea has a centre and a radius of 0 or more, in pixels");
    }
  }
  return {};
}

// A view's fovea, no farther off and no larger than where floats tell squares apart; without one,
// one that covers any picture.
inline Fovea fovea_of(const View& view) {
  static constexpr float kFarthest = 1e6f, kLargest = 1e7f;  // pixels
  if (!view.fovea) return {{0.0f, 0.0f}, kLargest};
  const auto within = [](float x) { return std::clamp(x, -kFarthest, kFarthest); };
  const Fovea& asked = *view.fovea;
  return {{within(asked.centre.x), within(asked.centre.y)}, std::min(asked.radius, kLargest)};
}

}  // namespace stgs::player
