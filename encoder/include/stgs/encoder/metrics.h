// SPDX-License-Identifier: Apache-2.0
// Image quality metrics. All functions take planar RGB images in [0,1] of equal size.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Converts an 8-bit RGB image to planar floats in [0,1].
Image to_float(const Image8& image);

inline constexpr double kPsnrMax = 100;  // dB, reported for identical images

// Checks that every value is finite. kInvalidFile names `name`, which identifies the image, and the
// first channel and pixel that fail. The metrics below require images that pass this check.
Status check_finite(const Image& image, const std::string& name);

// Returns the mean squared error over all pixels and channels.
double mean_squared_error(const Image& a, const Image& b);
// Returns -10 log10(mse), the PSNR for a peak of 1, at most kPsnrMax; NaN for NaN.
double psnr_of(double mse);
// Returns the largest absolute difference over all pixels and channels.
double max_difference(const Image& a, const Image& b);

// Returns the mean squared error that remains after the affine colour map (3x4, from `image` to
// `ground_truth`) that minimises it, fitted to this image; mapped values are not clamped.
double colour_corrected_error(const Image& image, const Image& ground_truth);

// Structural similarity (Wang et al. 2004): 11x11 Gaussian window, sigma 1.5, K1 0.01, K2 0.03;
// mean over RGB and over the positions where the window lies inside the image.
struct Ssim {
  double range_1 = 0;  // data range 1
  double range_2 = 0;  // data range 2, as some papers report
};
// Returns the working memory of ssim() for images of this width, pixels; bytes.
std::uint64_t ssim_bytes(int width);
// Computes both SSIM values. kUnsupported if an image side is shorter than 11 pixels.
Result<Ssim> ssim(const Image& a, const Image& b);

}  // namespace stgs::encoder
