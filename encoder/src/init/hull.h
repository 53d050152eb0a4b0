// SPDX-License-Identifier: Apache-2.0
// The visual hull of what moves in one frame.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// What one view says about the moving part of the scene.
struct Silhouette {
  View view;
  cv::Mat mask;      // 8-bit, 255: moving
  cv::Mat integral;  // CV_32S sums of mask / 255, one larger each way
  cv::Mat behind;    // CV_32F depth of the static scene where it was checked, else 0; may be empty
};
Silhouette make_silhouette(const View& view, const cv::Mat& mask, const cv::Mat& behind);

struct Box {
  cv::Vec3d low, high;
  bool empty() const { return !(low[0] < high[0] && low[1] < high[1] && low[2] < high[2]); }
};

// Set of cells of a regular grid. A cell belongs to the hull if its centre is inside the masks of
// nearly all views that see it (one miss in eight is forgiven) and of at least three of them (two
// where there are only two). A view whose static surface lies in front of the cell does not see it.
class VisualHull {
 public:
  // Carves `bounds` from coarse to fine: first to find the box that holds the hull, then inside
  // that box with cells of `cell` scene units (larger where that would be more than 192 a side).
  static VisualHull carve(const std::vector<Silhouette>& silhouettes, const Box& bounds,
                          double nearest, double cell);

  bool empty() const { return count_ == 0; }
  std::size_t count() const { return count_; }
  double cell() const { return cell_; }
  bool contains(const cv::Vec3d& p) const {
    const cv::Vec3d g = (p - box_.low) * (1 / cell_);
    if (g[0] < 0 || g[1] < 0 || g[2] < 0) return false;
    const int x = int(g[0]), y = int(g[1]), z = int(g[2]);
    if (x >= size_[0] || y >= size_[1] || z >= size_[2]) return false;
    return inside_[index(x, y, z)] != 0;
  }
  // Centres of the cells that have a neighbour outside.
  std::vector<cv::Vec3d> surface() const;

 private:
  std::size_t index(int x, int y, int z) const {
    return (std::size_t(z) * size_[1] + y) * size_[0] + x;
  }
  cv::Vec3d centre(int x, int y, int z) const {
    return box_.low + cell_ * cv::Vec3d(x + 0.5, y + 0.5, z + 0.5);
  }
  void allocate(const Box& box, double cell);
  // Visits the cube of 2^level cells a side at (x, y, z).
  void carve_cube(const std::vector<Silhouette>& silhouettes, double nearest, bool conservative,
                  int level, int x, int y, int z);

  Box box_;
  double cell_ = 1;
  std::array<int, 3> size_{0, 0, 0};
  std::vector<std::uint8_t> inside_;
  std::size_t count_ = 0;
};

// Box of everything that at least `views_needed` views see between the two depths; empty if none.
Box seen_box(const std::vector<View>& views, double nearest, double farthest, int views_needed);

}  // namespace stgs::encoder::init
