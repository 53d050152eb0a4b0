// SPDX-License-Identifier: Apache-2.0
#include "train/image_loss.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "stgs/format/parallel.h"
#include "train/image_loss_rows.h"
#include "train/loss_rows.h"

namespace stgs::encoder {
namespace {

using image_loss::kTapRadius;
using image_loss::kTaps;

std::array<float, kTaps> window() {
  std::array<double, kTaps> w{};
  double sum = 0;
  for (int k = 0; k < kTaps; ++k)
    sum += w[k] = std::exp(-(k - kTapRadius) * (k - kTapRadius) / (2.0 * 1.5 * 1.5));
  std::array<float, kTaps> taps{};
  for (int k = 0; k < kTaps; ++k) taps[k] = static_cast<float>(w[k] / sum);
  return taps;
}

template <typename Work>
void for_each_row(int height, Work work) {
  parallel_blocks(int{0}, height, kLossRows, [&](int first, int last) {
    for (int y = first; y < last; ++y) work(y);
  });
}

}  // namespace

void ImageLoss::Plane::reshape(int width, int height) {
  stride = static_cast<std::size_t>((width + 15) / 16 * 16 + 2 * kPad);
  data.assign(stride * static_cast<std::size_t>(height), 0.0f);
}

void ImageLoss::reshape(int width, int height) {
  if (width == width_ && height == height_) return;
  width_ = width;
  height_ = height;
  for (Plane* plane : {&x_, &y_, &ssim_}) plane->reshape(width, height);
  for (Plane& plane : blurred_) plane.reshape(width, height);
  for (Plane& plane : slope_) plane.reshape(width, height);
  for (Plane& plane : slope_blurred_) plane.reshape(width, height);
  zero_row_.assign(x_.stride, 0.0f);
  row_errors_.resize(static_cast<std::size_t>(height));
  row_ssim_.resize(static_cast<std::size_t>(height));
}

ImageLossValue ImageLoss::evaluate(const Image& rendered, const Image8& ground_truth,
                                   const ImageLossWeights& weights, Image& d_colour, Image& error) {
  static const std::array<float, kTaps> taps = window();
  const int w = rendered.width, h = rendered.height;
  reshape(w, h);
  d_colour.reshape(w, h, 3);
  error.reshape(w, h, 1);
  const double values = 3.0 * w * h;
  const float l1_scale = static_cast<float>(weights.l1 / values);
  const float ssim_scale = static_cast<float>(-weights.ssim / values);
  const auto around = [&](Plane& plane, int y, const float*(&rows)[kTaps]) {
    for (int k = 0; k < kTaps; ++k) {
      const int at = y + k - kTapRadius;
      rows[k] = at < 0 || at >= h ? zero_row_.data() + kPad : plane.row(at);
    }
  };

  ImageLossValue value;
  std::fill(ssim_.data.begin(), ssim_.data.end(), 0.0f);
  for (int c = 0; c < 3; ++c) {
    for_each_row(h, [&](int y) {
      const std::size_t first = static_cast<std::size_t>(y) * w;
      float* ground_truth_row = y_.row(y);
      std::copy_n(rendered.plane(c) + first, w, x_.row(y));
      for (int x = 0; x < w; ++x)
        ground_truth_row[x] =
            static_cast<float>(ground_truth.data[3 * (first + x) + c]) * (1.0f / 255.0f);
      image_loss::BlurRow rows{x_.row(y), ground_truth_row, {}};
      for (int m = 0; m < 5; ++m) rows.out[m] = blurred_[m].row(y);
      image_loss::blur_row(rows, taps.data(), w);
    });
    for_each_row(h, [&](int y) {
      image_loss::SsimRow rows;
      for (int m = 0; m < 5; ++m) around(blurred_[m], y, rows.means[m]);
      image_loss::BlurSlopeRow blur{};
      rows.ssim = ssim_.row(y);
      for (int m = 0; m < 3; ++m) {
        blur.in[m] = rows.slope[m] = slope_[m].row(y);
        blur.out[m] = slope_blurred_[m].row(y);
      }
      row_ssim_[y] = image_loss::ssim_row(rows, taps.data(), w);
      image_loss::blur_slope_row(blur, taps.data(), w);
    });
    for_each_row(h, [&](int y) {
      image_loss::GradientRow rows;
      for (int m = 0; m < 3; ++m) around(slope_blurred_[m], y, rows.slope[m]);
      rows.x = x_.row(y);
      rows.y = y_.row(y);
      rows.out = d_colour.plane(c) + static_cast<std::size_t>(y) * w;
      row_errors_[y] = image_loss::gradient_row(rows, taps.data(), l1_scale, ssim_scale, w);
    });
    for (const image_loss::RowErrors& row : row_errors_) {
      value.l1 += row.absolute / values;
      value.mse += row.squared / values;
    }
    value.ssim += std::accumulate(row_ssim_.begin(), row_ssim_.end(), 0.0) / values;
  }
  for_each_row(h, [&](int y) {
    const float* ssim = ssim_.row(y);
    float* out = error.data.data() + static_cast<std::size_t>(y) * w;
    for (int x = 0; x < w; ++x) out[x] = std::clamp(1.0f - ssim[x] / 3.0f, 0.0f, 1.0f);
  });
  value.loss = weights.l1 * value.l1 + weights.ssim * (1.0 - value.ssim);
  return value;
}

}  // namespace stgs::encoder
