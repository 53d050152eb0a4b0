// SPDX-License-Identifier: Apache-2.0
#include "train/image_loss_rows.h"

#include <algorithm>
#include <cstddef>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "train/image_loss_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::image_loss::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::CappedTag<float, 16>;  // the padding of a row holds one vector
using V = hn::Vec<Tag>;

constexpr float kC1 = 0.01f * 0.01f, kC2 = 0.03f * 0.03f;

void blur(const BlurRow& rows, const float* HWY_RESTRICT taps, int width) {
  const Tag d;
  for (int i = 0; i < width; i += static_cast<int>(hn::Lanes(d))) {
    V x = hn::Zero(d), y = x, xx = x, yy = x, xy = x;
    for (int k = 0; k < kTaps; ++k) {
      const V tap = hn::Set(d, taps[k]);
      const V a = hn::LoadU(d, rows.x + i + k - kTapRadius);
      const V b = hn::LoadU(d, rows.y + i + k - kTapRadius);
      const V wa = hn::Mul(tap, a), wb = hn::Mul(tap, b);
      x = hn::Add(x, wa);
      y = hn::Add(y, wb);
      xx = hn::MulAdd(wa, a, xx);
      yy = hn::MulAdd(wb, b, yy);
      xy = hn::MulAdd(wa, b, xy);
    }
    const V results[5] = {x, y, xx, yy, xy};
    for (int m = 0; m < 5; ++m) hn::StoreU(results[m], d, rows.out[m] + i);
  }
}

HWY_INLINE V column_mean(const float* const* rows, const float* HWY_RESTRICT taps, int i) {
  const Tag d;
  V sum = hn::Mul(hn::Set(d, taps[kTapRadius]), hn::LoadU(d, rows[kTapRadius] + i));
  for (int k = 0; k < kTapRadius; ++k) {
    const V pair = hn::Add(hn::LoadU(d, rows[k] + i), hn::LoadU(d, rows[kTaps - 1 - k] + i));
    sum = hn::MulAdd(hn::Set(d, taps[k]), pair, sum);
  }
  return sum;
}

double ssim(const SsimRow& rows, const float* HWY_RESTRICT taps, int width) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const V one = hn::Set(d, 1.0f), two = hn::Set(d, 2.0f);
  const V c1 = hn::Set(d, kC1), c2 = hn::Set(d, kC2);
  V sum = hn::Zero(d);
  for (int i = 0; i < width; i += lanes) {
    const V x = column_mean(rows.means[0], taps, i), y = column_mean(rows.means[1], taps, i);
    const V xx = column_mean(rows.means[2], taps, i), yy = column_mean(rows.means[3], taps, i);
    const V xy = column_mean(rows.means[4], taps, i);
    const V x_y = hn::Mul(x, y), squares = hn::MulAdd(x, x, hn::Mul(y, y));
    const V a1 = hn::MulAdd(two, x_y, c1);
    const V a2 = hn::MulAdd(two, hn::Sub(xy, x_y), c2);
    const V b1 = hn::Add(squares, c1);
    const V b2 = hn::Add(hn::Sub(hn::Add(xx, yy), squares), c2);
    const V inverse = hn::Div(one, hn::Mul(b1, b2));
    const V s = hn::Mul(hn::Mul(a1, a2), inverse);
    // S = a1 a2 / (b1 b2); the variances hold -x^2 and -xy.
    const V by_a1 = hn::Mul(a2, inverse), by_a2 = hn::Mul(a1, inverse);
    const V by_b1 = hn::Neg(hn::Mul(hn::Mul(s, inverse), b2));
    const V by_b2 = hn::Neg(hn::Mul(hn::Mul(s, inverse), b1));
    const V by_x =
        hn::Mul(two, hn::MulAdd(y, hn::Sub(by_a1, by_a2), hn::Mul(x, hn::Sub(by_b1, by_b2))));
    const auto inside = hn::FirstN(d, static_cast<std::size_t>(std::min(lanes, width - i)));
    const V masked = hn::IfThenElseZero(inside, s);
    sum = hn::Add(sum, masked);
    hn::StoreU(hn::Add(hn::LoadU(d, rows.ssim + i), masked), d, rows.ssim + i);
    hn::StoreU(hn::IfThenElseZero(inside, by_x), d, rows.slope[0] + i);
    hn::StoreU(hn::IfThenElseZero(inside, by_b2), d, rows.slope[1] + i);
    hn::StoreU(hn::IfThenElseZero(inside, hn::Mul(two, by_a2)), d, rows.slope[2] + i);
  }
  return hn::GetLane(hn::SumOfLanes(d, sum));
}

void blur_slope(const BlurSlopeRow& rows, const float* HWY_RESTRICT taps, int width) {
  const Tag d;
  for (int m = 0; m < 3; ++m) {
    for (int i = 0; i < width; i += static_cast<int>(hn::Lanes(d))) {
      V sum = hn::Zero(d);
      for (int k = 0; k < kTaps; ++k)
        sum = hn::MulAdd(hn::Set(d, taps[k]), hn::LoadU(d, rows.in[m] + i + k - kTapRadius), sum);
      hn::StoreU(sum, d, rows.out[m] + i);
    }
  }
}

RowErrors gradient(const GradientRow& rows, const float* HWY_RESTRICT taps, float l1_scale,
                   float ssim_scale, int width) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const V zero = hn::Zero(d), l1 = hn::Set(d, l1_scale), by_ssim = hn::Set(d, ssim_scale);
  V absolute = zero, squared = zero;
  for (int i = 0; i < width; i += lanes) {
    const V x = hn::LoadU(d, rows.x + i), y = hn::LoadU(d, rows.y + i);
    const V by_x = column_mean(rows.slope[0], taps, i);
    const V by_xx = column_mean(rows.slope[1], taps, i);
    const V by_xy = column_mean(rows.slope[2], taps, i);
    const V slope = hn::MulAdd(hn::Add(x, x), by_xx, hn::MulAdd(y, by_xy, by_x));
    const V difference = hn::Sub(x, y);
    const V sign = hn::IfThenElse(hn::Eq(difference, zero), zero, hn::CopySign(l1, difference));
    const V result = hn::MulAdd(by_ssim, slope, sign);
    // x and y are 0 beyond the width, so the padding adds nothing.
    absolute = hn::Add(absolute, hn::Abs(difference));
    squared = hn::MulAdd(difference, difference, squared);
    if (width - i >= lanes) {
      hn::StoreU(result, d, rows.out + i);
    } else {
      HWY_ALIGN float tail[16];
      hn::Store(result, d, tail);
      std::copy_n(tail, width - i, rows.out + i);
    }
  }
  return {hn::GetLane(hn::SumOfLanes(d, absolute)), hn::GetLane(hn::SumOfLanes(d, squared))};
}

}  // namespace
}  // namespace stgs::encoder::image_loss::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::image_loss {

HWY_EXPORT(blur);
HWY_EXPORT(ssim);
HWY_EXPORT(blur_slope);
HWY_EXPORT(gradient);

void blur_row(const BlurRow& rows, const float* taps, int width) {
  HWY_DYNAMIC_DISPATCH(blur)(rows, taps, width);
}

double ssim_row(const SsimRow& rows, const float* taps, int width) {
  return HWY_DYNAMIC_DISPATCH(ssim)(rows, taps, width);
}

void blur_slope_row(const BlurSlopeRow& rows, const float* taps, int width) {
  HWY_DYNAMIC_DISPATCH(blur_slope)(rows, taps, width);
}

RowErrors gradient_row(const GradientRow& rows, const float* taps, float l1_scale, float ssim_scale,
                       int width) {
  return HWY_DYNAMIC_DISPATCH(gradient)(rows, taps, l1_scale, ssim_scale, width);
}

}  // namespace stgs::encoder::image_loss
#endif
