// SPDX-License-Identifier: Apache-2.0
// How near a picture is to another. Pictures are planar RGB in [0,1] of the same size.
#pragma once

#include <string>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// An 8-bit RGB picture as planar floats in [0,1].
Image to_float(const Image8& picture);

inline constexpr double kPsnrMax = 100;  // dB, reported for identical pictures

// Whether every value is a number: kInvalidFile with the first channel and pixel that is not.
// `name` says which picture it is. The measures below want pictures that pass.
Status check_finite(const Image& image, const std::string& name);

// Mean squared error over all pixels and channels.
double mean_squared_error(const Image& a, const Image& b);
// -10 log10(mse) for a peak of 1, at most kPsnrMax; NaN for NaN.
double psnr_of(double mse);
double max_difference(const Image& a, const Image& b);

// The error that is left after the affine colour map (3x4, from picture to truth) that makes it
// least, found for this picture; mapped values are not clamped.
double colour_corrected_error(const Image& picture, const Image& truth);

// Structural similarity (Wang et al. 2004): 11x11 Gaussian window, sigma 1.5, K1 0.01, K2 0.03;
// mean over RGB and over the positions where the window lies inside the picture.
struct Ssim {
  double range_1 = 0;  // data range 1
  double range_2 = 0;  // data range 2, as some papers report
};
// kUnsupported where a side is under 11 pixels.
Result<Ssim> ssim(const Image& a, const Image& b);

}  // namespace stgs::encoder
