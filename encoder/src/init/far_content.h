// SPDX-License-Identifier: Apache-2.0
// Sky and far background. Stereo does not confirm them, because they lie beyond its range or have
// no texture, and depth interpolated from the content around would put them in front of other
// content.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "init/cover.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Finds far pixels among those without a weight, and sets their depth to `distance` from the view,
// their normal (towards the view) and `weight`. An area is far if it has texture that other views
// show in the same direction, or if it adjoins such an area without an edge, or has its colours,
// which near content does not have. The surfaces have normals; `usable`: for each, 8-bit, 255 where
// its image is valid. Returns whether there are any. Takes one pass of the stage.
Result<bool> place_far_content(const std::vector<cv::Mat>& usable, const cv::Vec3d& focus,
                               double distance, float weight, Work& work,
                               std::vector<Surface>* surfaces);

}  // namespace stgs::encoder::init
