// SPDX-License-Identifier: Apache-2.0
// How much each primitive matters to the pictures that a scene was trained on.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/gaussian4d.h"

namespace stgs::encoder {

// A moment from a viewpoint, at which primitives are weighed.
struct ImportanceView {
  math::PinholeCamera camera;
  float ticks = 0;  // frames
};

// `count` of them at half the size of the pictures, spread over training cameras and frames; none
// where no camera trains.
std::vector<ImportanceView> importance_views(const PreparedCapture& capture, int count);

// Scene::importance: for each primitive the sum over all pixels of the views of the square of its
// blend weight, which is what an error of its colour is weighted by in the mean square error of the
// pictures. `go_on` is called before each with the share that is done; nothing where it answers
// false. The CPU's; a training backend has its own (backend.h).
std::optional<std::vector<float>> view_importance(const Gaussians4D& set,
                                                  std::span<const ImportanceView> views,
                                                  const std::function<bool(double)>& go_on);

}  // namespace stgs::encoder
