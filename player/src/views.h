// SPDX-License-Identifier: Apache-2.0
// What every backend asks of a call.
#pragma once

#include <cmath>
#include <vector>

#include "stgs/player/renderer.h"

namespace stgs::player {

inline constexpr float kMaxSide = 32768;  // pixels

// kUsage where there are too few or too many views, or one of a size that cannot be drawn.
inline Status check_views(const std::vector<View>& views) {
  if (views.empty() || views.size() > kMaxViews) {
    return usage_error("a call draws 1 to {} views, not {}", kMaxViews, views.size());
  }
  for (const View& view : views) {
    const auto side = [](float v) { return v >= 1 && v <= kMaxSide; };
    if (!side(view.camera.width) || !side(view.camera.height)) {
      return usage_error("a view of {}x{} pixels cannot be drawn; each side is 1 to {}",
                         view.camera.width, view.camera.height, kMaxSide);
    }
    if (view.fovea && !(view.fovea->radius >= 0 && std::isfinite(view.fovea->centre.x) &&
                        std::isfinite(view.fovea->centre.y))) {
      return usage_error("a view's fovea has a centre and a radius of 0 or more, in pixels");
    }
  }
  return {};
}

}  // namespace stgs::player
