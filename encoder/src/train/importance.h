// SPDX-License-Identifier: Apache-2.0
// Importance: how much each primitive contributes to the images that a scene was trained on.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/gaussian4d.h"

namespace stgs::encoder {

// A camera at a time.
struct ImportanceView {
  math::PinholeCamera camera;
  float ticks = 0;  // frames
  int kernel = 0;   // of the splats
};

inline constexpr int kImportanceViews = 256;  // of a run

// Returns `count` views at half the image size, spread over training cameras and frames, half of
// them with a wider field of view; none if there are no training cameras.
std::vector<ImportanceView> importance_views(const PreparedCapture& capture, int count, int kernel);

// Computes Scene::importance on the CPU: for each primitive the sum of its squared blend weights
// over all pixels of the views. An error of its colour enters the images' mean squared error with
// this weight. Calls `should_continue` before each view with the fraction done; returns nullopt if
// it returns false. Training backends have their own implementation (backend.h).
std::optional<std::vector<float>> view_importance(
    const Gaussians4D& set, std::span<const ImportanceView> views,
    const std::function<bool(double)>& should_continue);

}  // namespace stgs::encoder
