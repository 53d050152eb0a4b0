// SPDX-License-Identifier: Apache-2.0
// Matching costs of a plane sweep, with vectors over the pixels of a row: normalised correlation of
// square windows, and their difference of colour.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stgs::encoder::geometry {

// The columns [first, last) of a row.
struct Columns {
  int first, last;
};

// The swept part of an image, with fewer than 2^31 pixels. Windows continue beyond its border with
// the values on it. Rows are padded to whole vectors: pixel (x, y) is at y * pitch + x.
struct SweepReference {
  int width = 0, height = 0, pitch = 0;
  int window = 1;                           // side, pixels, odd
  std::vector<float> grey, mean, variance;  // the latter two of the windows
  // For each row, whole vectors: where costs are wanted, where windows are summed up for these, and
  // where sources are sampled for the sums.
  std::vector<Columns> costs, sums, samples;
};
// Computes the statistics of the windows of `grey`, width x height values. `mask`, of rows `step`
// bytes apart: 0 where the cost of a pixel does not matter; null: all costs are wanted.
SweepReference make_sweep_reference(const std::vector<float>& grey, int width, int height,
                                    int window, const std::uint8_t* mask = nullptr,
                                    std::ptrdiff_t step = 0);

// An image to compare with. `corners`: see StereoImage.
struct SweepSource {
  const std::uint32_t* corners;  // width x height
  const std::uint32_t* usable;   // width x height, 0: unusable; null: all pixels are usable
  int width, height;
};

// The costs of one plane against the sources so far, in [0, 1], in the rows of the reference.
struct PlaneCosts {
  std::vector<float> first, second;          // the two smallest; 1 if fewer sources see the pixel
  std::vector<float> seen;                   // the number of sources that see the pixel
  std::vector<float> warped, visible, sums;  // of one source, while it is added
};
// Sets the costs to those without a source.
void reset(const SweepReference& reference, PlaneCosts* costs);

// Adds a source to costs after reset(). `h`: row-major homography from the indices of the
// reference's pixels to the source's. Thread-safe for different costs.
void add_source(const SweepReference& reference, const SweepSource& source, const float (&h)[9],
                PlaneCosts* costs);

// Writes volume_cost() of all pixels, width x height values, undefined where costs do not matter.
void volume_costs(const SweepReference& reference, const PlaneCosts& costs, std::uint8_t* out);

}  // namespace stgs::encoder::geometry
