// SPDX-License-Identifier: Apache-2.0
// Finds the depth of a few pixels by comparing images along their rays.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "train/set_views.h"

namespace stgs::encoder {

class RayProbe {
 public:
  // `images`: of one time, empty where there is none. `shown`: renderings of the persistent set,
  // which determine the depths that are considered. Views and images must outlive the object.
  RayProbe(const SetViews& views, const std::vector<Image>& images,
           const std::vector<SetView>& shown);

  // Returns the camera z of the surface that a view with an image shows at a pixel: `expected` if
  // the images allow it, 0 if they do not determine it.
  float depth(std::size_t view, int x, int y, float expected) const;

 private:
  // Returns the mean difference from the other views around a pixel, if it has this depth; infinite
  // if too few of them see it.
  float cost(std::size_t view, int x, int y, float depth) const;

  const SetViews& views_;
  const std::vector<Image>& images_;
  float nearest_ = INFINITY, farthest_ = 0;         // depths, scene units
  std::vector<std::vector<std::size_t>> partners_;  // per view, nearest first
};

}  // namespace stgs::encoder
