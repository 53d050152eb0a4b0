// SPDX-License-Identifier: Apache-2.0
// Visual hull of the dynamic content of one frame.
#pragma once

#include <array>
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

// A set of cells of a regular grid. A cell belongs to the hull if its centre is inside the mask
//   - in at least three of the views that see it (two if there are only two views), and
//   - in nearly all of them (about one miss in eight is allowed).
// A view does not see a cell that lies behind its static surface.
class VisualHull {
 public:
  // Carves `bounds`: first coarsely to find the box of the hull, then inside that box with cells of
  // `cell` scene units (larger if that exceeds 192 cells per side).
  static VisualHull carve(const std::vector<Silhouette>& silhouettes, const Box& bounds,
                          double nearest, double cell);

  bool empty() const { return count_ == 0; }
  std::size_t count() const { return count_; }  // number of cells
  double cell() const { return cell_; }         // side of a cell, scene units
  bool contains(const cv::Vec3d& p) const {
    const cv::Vec3d g = (p - box_.low) * (1 / cell_);
    if (g[0] < 0 || g[1] < 0 || g[2] < 0) return false;
    const int x = int(g[0]), y = int(g[1]), z = int(g[2]);
    if (x >= size_[0] || y >= size_[1] || z >= size_[2]) return false;
    return inside_[index(x, y, z)] != 0;
  }
  // Returns the centres of the cells that have a neighbour outside the hull.
  std::vector<cv::Vec3d> surface() const;

 private:
  std::size_t index(int x, int y, int z) const {
    return (std::size_t(z) * size_[1] + y) * size_[0] + x;
  }
  cv::Vec3d centre(int x, int y, int z) const {
    return box_.low + cell_ * cv::Vec3d(x + 0.5, y + 0.5, z + 0.5);
  }
  void allocate(const Box& box, double cell);
  // Visits the cube of 2^level cells per side at (x, y, z).
  void carve_cube(const std::vector<Silhouette>& silhouettes, double nearest, bool conservative,
                  int level, int x, int y, int z);

  Box box_;
  double cell_ = 1;
  std::array<int, 3> size_{0, 0, 0};
  std::vector<std::uint8_t> inside_;
  std::size_t count_ = 0;
};

// Returns the box of the points between the two depths that at least `views_needed` views see.
// Empty if there are none.
Box visible_box(const std::vector<View>& views, double nearest, double farthest, int views_needed);

}  // namespace stgs::encoder::init
