// SPDX-License-Identifier: Apache-2.0
// L_n: the normals that the primitives have against the normals of the depth that they draw (paper
// 3.4, after PGSR's single-view loss).
//
//   L_n = mean over all pixels of clamp(1 - |grad I|, 0, 1)^2 |alpha N_depth - N_render|_1
//
// N_render is the blend of the primitives' normals, alpha the pixel's opacity (held constant), and
// N_depth the normalised cross product of the differences between the points, back-projected by
// the planes' depth (math/surface.h), of the pixels below and above and of those right and left.
// |grad I| is the larger of the truth's central differences along x and y, mean of absolute values
// over channels, scaled to [0,1] between its least and its largest value in the picture. A pixel at
// the border, or one that shows no surface or has a neighbour that shows none, adds 0.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/math/surface.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {

// Sum over the channels of the larger absolute difference, 0 .. 765; exact, so that every backend
// has the same. (x, y) is no pixel of the border.
int picture_difference(const Image8& picture, int x, int y);

// Keeps its working memory. Results do not depend on the number of threads. One call at a time per
// object.
class NormalLoss {
 public:
  // Returns L_n and fills d_surface with `weight` times its gradient by the blended planes (4
  // planes: normal x, y, z, distance). `surface`: blend of the primitives' planes, with the normal
  // in its colour (background 0) and the distance in its depth, hence divided by alpha. `truth`:
  // RGB of the same size.
  double evaluate(const RasterOutput& surface, const Image8& truth,
                  const math::PinholeCamera& camera, float weight, Image& d_surface);

 private:
  void find_differences(const Image8& truth);
  void evaluate_row(const RasterOutput& surface, const math::PinholeCamera& camera, float scale,
                    int y, Image& d_surface);
  void gather_row(const RasterOutput& surface, const math::PinholeCamera& camera, int y,
                  Image& d_surface) const;

  int width_ = 0, height_ = 0;
  std::vector<float> depth_;                    // of each pixel; 0: no surface
  std::vector<math::Vec3> by_down_, by_right_;  // gradients by the differences of points
  std::vector<std::uint16_t> difference_;       // picture_difference
  std::vector<int> row_least_, row_most_;       // of difference_
  std::vector<double> row_sum_;
  int least_ = 0, most_ = 0;
};

}  // namespace stgs::encoder
