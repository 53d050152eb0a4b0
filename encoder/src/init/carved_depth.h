// SPDX-License-Identifier: Apache-2.0
// Depth that no other view contradicts.
#pragma once

#include <vector>

#include "init/cover.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Weights from here on are of depth that stereo confirms, or far; those of swept depth are smaller.
inline constexpr float kStereoWeight = 2.0f;

// Returns whether a point lies in front of such depth in any view.
bool is_contradicted(const std::vector<Surface>& surfaces, const cv::Vec3d& point);

// Moves contradicted depth of pixels without a weight to the nearest inverse depth between the two
// limits that no view contradicts, if there is one. Takes one pass of the stage.
Status carve_depth(double nearest, double farthest, Work& work, std::vector<Surface>* surfaces);

}  // namespace stgs::encoder::init
