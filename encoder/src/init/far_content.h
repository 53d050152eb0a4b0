// SPDX-License-Identifier: Apache-2.0
// Sky and far background of a sparse rig. Stereo does not confirm them, because they lie beyond its
// range or have no texture, and depth interpolated from the content around would put them in front
// of other content.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "init/cover.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Finds far pixels among those without a weight, and sets their depth, their normal (towards the
// view) and `weight`. An area is far if it has texture that other views see in the same direction,
// or if it adjoins such an area without an edge, or has its colours, which no near content has.
// `usable`: for each surface, 8-bit, 255 where its image is valid. Returns the distance of the far
// pixels from the views, at which they move by at most a pixel between any two cameras; 0 if there
// are none. Takes one pass of the stage.
Result<double> place_far_content(const std::vector<cv::Mat>& usable, const cv::Vec3d& focus,
                                 float weight, Work& work, std::vector<Surface>* surfaces);

}  // namespace stgs::encoder::init
