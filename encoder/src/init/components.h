// SPDX-License-Identifier: Apache-2.0
// Connected components of motion masks.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace stgs::encoder::init {

// The pixels [first, last) of row y.
struct Run {
  int y, first, last;
  int component;
};

struct Component {
  int area = 0;  // pixels
  bool at_border = false;
};

struct Components {
  std::vector<Run> runs;  // row by row, from the left
  std::vector<Component> components;
};

// Returns the components of the pixels of a mask (0 or 255) that have `value`. `diagonal`: pixels
// that touch at a corner are connected.
Components find_components(const cv::Mat& mask, std::uint8_t value, bool diagonal);

}  // namespace stgs::encoder::init
