// SPDX-License-Identifier: Apache-2.0
// Semi-global matching: the smoothing of a cost volume along paths.
#pragma once

#include <cstdint>
#include <vector>

namespace stgs::encoder::geometry {

// The costs of all planes of each pixel of a region, and their sums over paths: plane k of pixel
// (x, y) is at at(x, y) + k. Planes are padded to whole vectors.
struct CostVolume {
  CostVolume(int width_, int height_, int planes_);

  std::size_t at(int x, int y) const { return (static_cast<std::size_t>(y) * width + x) * pitch; }

  int width, height, planes, pitch;
  std::vector<std::uint8_t> cost;  // see sweep_rule.h
  std::vector<std::uint16_t> sum;  // of all directions so far
};

// Adds the costs of the paths that reach each pixel (x, y) from (x - dx, y - dy) to the sums.
// `grey`: width x height values. dx and dy are -1, 0 or 1, one of them 0.
void add_paths(const std::vector<float>& grey, int dx, int dy, CostVolume* volume);

}  // namespace stgs::encoder::geometry
