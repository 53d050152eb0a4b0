// SPDX-License-Identifier: Apache-2.0
// The loss of a rendered image against the ground truth: L = w_l1 L1 + w_ssim (1 - SSIM).
#pragma once

#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"
#include "train/image_loss_rows.h"

namespace stgs::encoder {

struct ImageLossWeights {
  float l1 = 0.8f;
  float ssim = 0.2f;
};

struct ImageLossValue {
  double loss = 0;  // weighted
  double l1 = 0;    // mean |rendered - ground truth| over pixels and channels
  double mse = 0;   // mean squared difference
  double ssim = 0;  // mean over pixels and channels
};

// SSIM uses an 11 x 11 Gaussian window of sigma 1.5 with zero padding, C1 = 0.01^2, C2 = 0.03^2.
// Reuses its working memory: repeated calls with the same size do not allocate. Results do not
// depend on the number of threads. One call at a time per object.
class ImageLoss {
 public:
  // Returns the loss and fills d_colour (3 planes, dL/drendered) and error (1 plane, 1 - SSIM
  // averaged over channels, in [0,1]). `rendered` has 3 planes, nominally in [0,1]; `ground_truth`
  // is RGB of the same size.
  ImageLossValue evaluate(const Image& rendered, const Image8& ground_truth,
                          const ImageLossWeights& weights, Image& d_colour, Image& error);

 private:
  // Rows are padded with zeros on both sides, so that windows may cross the edges.
  struct Plane {
    std::size_t stride = 0;
    std::vector<float> data;
    void reshape(int width, int height);
    float* row(int y) { return data.data() + static_cast<std::size_t>(y) * stride + kPad; }
  };
  static constexpr int kPad = 16;

  void reshape(int width, int height);

  int width_ = 0, height_ = 0;
  Plane x_, y_;                        // rendered and ground-truth values of a channel
  Plane blurred_[5];                   // x, y, xx, yy, xy, blurred along rows
  Plane slope_[3], slope_blurred_[3];  // dSSIM/d(window means of x, xx, xy); blurred along rows
  Plane ssim_;                         // summed over channels
  std::vector<float> zero_row_;
  std::vector<image_loss::RowErrors> row_errors_;
  std::vector<double> row_ssim_;
};

}  // namespace stgs::encoder
