// SPDX-License-Identifier: Apache-2.0
// Visual hull of the dynamic content of one frame.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// Silhouette of the dynamic content in one view.
struct Silhouette {
  View view;
  cv::Mat mask;      // 8-bit, 255: moving
  cv::Mat integral;  // CV_32S integral image of mask / 255, one pixel larger each way
  cv::Mat behind;    // CV_32F depth of the static scene, 0 where not checked; may be empty
};
// Builds the integral image of the mask.
Silhouette make_silhouette(const View& view, const cv::Mat& mask, const cv::Mat& behind);

// An axis-aligned box in scene units.
struct Box {
  cv::Vec3d low, high;
  bool empty() const { return !(low[0] < high[0] && low[1] < high[1] && low[2] < high[2]); }
};

// A cube of the hull.
struct HullCell {
  cv::Vec3d centre;
  double side = 0;  // scene units
};

struct HullResolution {
  double side = 0;   // of the smallest cells, scene units
  double depth = 0;  // distance from the nearest view from which on cells grow with the distance
};

// An octree of cells. A cell belongs to the hull if its centre is inside the mask
//   - in at least three of the views that see it (two if there are only two views), and
//   - in nearly all of them (about one miss in eight is allowed).
// A view does not see a cell that lies behind its static surface.
class VisualHull {
 public:
  // Carves `bounds`, without anything nearer than `nearest` to a view. Cells are larger than
  // requested if there would be more than two million, or more than 30 million to examine.
  static VisualHull carve(const std::vector<Silhouette>& silhouettes, const Box& bounds,
                          double nearest, HullResolution resolution);

  bool empty() const { return count_ == 0; }
  std::size_t count() const { return count_; }  // number of cells
  bool contains(const cv::Vec3d& p) const;
  // Returns the cells that have a neighbour outside the hull.
  std::vector<HullCell> surface() const;

 private:
  // The eight parts of a cube, each the index of a node, or one of the two constants below.
  using Node = std::array<std::int32_t, 8>;
  static constexpr std::int32_t kOutside = -1, kInside = -2;

  class Carver;
  void collect(std::int32_t node, const HullCell& cube, std::vector<HullCell>* out) const;

  std::vector<Node> nodes_;
  std::int32_t root_ = kOutside;
  HullCell cube_;  // of the root
  std::size_t count_ = 0;
};

// Returns the box of the points between the two depths that at least `views_needed` views see.
// Empty if there are none.
Box visible_box(const std::vector<View>& views, double nearest, double farthest, int views_needed);

}  // namespace stgs::encoder::init
