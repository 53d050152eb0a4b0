// SPDX-License-Identifier: Apache-2.0
// SIMD row kernels of ImageLoss. Row pointers are to padded rows (ImageLoss::Plane); each kernel
// may write up to 15 values beyond `width`.
#pragma once

namespace stgs::encoder::image_loss {

inline constexpr int kTaps = 11;
inline constexpr int kTapRadius = kTaps / 2;

// Computes the window means along a row of x, y, x^2, y^2 and xy.
struct BlurRow {
  const float *x, *y;
  float* out[5];
};
void blur_row(const BlurRow& rows, const float* taps, int width);

// Completes the window means along the columns, adds SSIM to `ssim`, writes its derivatives with
// respect to the means of x, x^2 and xy, and returns the row's sum of SSIM.
struct SsimRow {
  const float* means[5][kTaps];  // the rows around this one
  float* ssim;
  float* slope[3];
};
double ssim_row(const SsimRow& rows, const float* taps, int width);

// Computes the window means along a row of three maps that are 0 beyond `width`.
struct BlurSlopeRow {
  const float* in[3];
  float* out[3];
};
void blur_slope_row(const BlurSlopeRow& rows, const float* taps, int width);

// Sums over a row of |x - y| and of (x - y)^2.
struct RowErrors {
  double absolute = 0, squared = 0;
};

// Computes dL/dx from the derivatives' means and from L1. `out` is not padded.
struct GradientRow {
  const float* slope[3][kTaps];
  const float *x, *y;
  float* out;
};
RowErrors gradient_row(const GradientRow& rows, const float* taps, float l1_scale, float ssim_scale,
                       int width);

}  // namespace stgs::encoder::image_loss
