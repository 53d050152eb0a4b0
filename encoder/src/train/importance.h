// SPDX-License-Identifier: Apache-2.0
// How much each primitive matters to the pictures that a scene was trained on.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/gaussian4d.h"

namespace stgs::encoder {

// Scene::importance: for each primitive the sum over all pixels of `views` half-size views of the
// square of its blend weight, which is what an error of its colour is weighted by in the mean
// square error of the pictures. The views are spread over training cameras and frames.
// `go_on` is called before each with the share that is done; nothing where it answers false.
std::optional<std::vector<float>> view_importance(const Gaussians4D& set,
                                                  const PreparedCapture& capture, int views,
                                                  const std::function<bool(double)>& go_on);

}  // namespace stgs::encoder
