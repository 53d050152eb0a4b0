// SPDX-License-Identifier: Apache-2.0
// L_n: consistency of the primitives' normals with the normals of the rendered depth (paper 3.4,
// after PGSR's single-view loss).
//
//   L_n = mean over all pixels of clamp(1 - |grad I|, 0, 1)^2 |alpha N_depth - N_render|_1
//
// - N_render is the blend of the primitives' normals; alpha is the pixel's opacity (held constant).
// - N_depth is the normalised cross product of two point differences: between the pixels below and
//   above, and between those to the right and left. The points are back-projected with the depth of
//   the blended planes (math/surface.h).
// - |grad I| is the larger of the ground truth's central differences along x and y, averaged as
//   absolute values over the channels, and scaled to [0,1] between its minimum and maximum over the
//   image.
// - A pixel adds 0 at the border, and if it or one of its four neighbours shows no surface.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/math/surface.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {

// Returns the larger of the central differences along x and y, each summed as absolute values over
// the channels, 0..765. Exact integers, so all backends agree. (x, y) must not be a border pixel.
int image_difference(const Image8& image, int x, int y);

// Reuses its working memory. Results do not depend on the number of threads. One call at a time per
// object.
class NormalLoss {
 public:
  // Returns L_n and fills d_surface with `weight` times its gradient with respect to the blended
  // planes (4 planes: normal x, y, z, distance).
  // - `surface`: blend of the primitives' planes, with the normal in its colour (background 0) and
  //   the distance in its depth, hence divided by alpha.
  // - `ground_truth`: RGB of the same size.
  double evaluate(const RasterOutput& surface, const Image8& ground_truth,
                  const math::PinholeCamera& camera, float weight, Image& d_surface);

 private:
  void compute_differences(const Image8& ground_truth);
  void evaluate_row(const RasterOutput& surface, const math::PinholeCamera& camera, float scale,
                    int y, Image& d_surface);
  void gather_row(const RasterOutput& surface, const math::PinholeCamera& camera, int y,
                  Image& d_surface) const;

  int width_ = 0, height_ = 0;
  std::vector<float> depth_;                    // per pixel; 0: no surface
  std::vector<math::Vec3> by_down_, by_right_;  // gradients of the point differences
  std::vector<std::uint16_t> difference_;       // image_difference
  std::vector<int> row_min_, row_max_;          // of difference_
  std::vector<double> row_sum_;
  int min_difference_ = 0, max_difference_ = 0;
};

}  // namespace stgs::encoder
