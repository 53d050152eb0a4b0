// SPDX-License-Identifier: Apache-2.0
// Visual hull of the dynamic content of one frame. A point belongs to it if it is inside the mask
//   - in at least three of the views that see it (two if there are only two views), and
//   - in nearly all of them (about one miss in eight is allowed).
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "init/silhouette.h"
#include "init/view.h"

namespace stgs::encoder::init {

// An axis-aligned box in scene units.
struct Box {
  cv::Vec3d low, high;
  bool empty() const { return !(low[0] < high[0] && low[1] < high[1] && low[2] < high[2]); }
};

struct HullCell {
  cv::Vec3d centre;
  double side = 0;  // of a cube, scene units
};

struct HullResolution {
  double side = 0;   // of the smallest cells, scene units
  double depth = 0;  // distance from the nearest view from which on cells grow with the distance
};

// Sets outside[k] to 1 for each point origin + depths[k] * ray that is not in the hull, else to 0.
// Nothing nearer than `nearest`, which is above 0, to a view is in the hull.
void find_outside(const std::vector<Silhouette>& silhouettes, const cv::Vec3d& origin,
                  const cv::Vec3d& ray, const std::vector<float>& depths, double nearest,
                  std::vector<std::uint8_t>* outside);

// Returns the cells within `bounds` of which the centre, or that of one of their eight parts, is in
// the hull. None for fewer than two silhouettes. Cells are larger than requested if there would be
// more than two million, or more than 30 million to examine.
std::vector<HullCell> hull_cells(const std::vector<Silhouette>& silhouettes, const Box& bounds,
                                 double nearest, HullResolution resolution);

// Returns the box of the points between the two depths that at least `views_needed` views see.
// Empty if there are none.
Box visible_box(const std::vector<View>& views, double nearest, double farthest, int views_needed);

}  // namespace stgs::encoder::init
