// SPDX-License-Identifier: Apache-2.0
#include "geometry/warp_tables.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace stgs::encoder::geometry {
namespace {

constexpr double kMinShare = 1e-3;  // of a sample that a scaled pixel covers
constexpr int kFarAway = 1 << 20;   // 1/32 pixels; beyond all images

// The cubic kernels: -f is the slope at distance 1.
double cubic(double distance, double f) {
  const double d = std::abs(distance);
  if (d < 1) return ((2 - f) * d - (3 - f)) * d * d + 1;
  return d < 2 ? f * (((5 - d) * d - 8) * d + 4) : 0;
}
constexpr double kScaleSlope = 0.6, kRemapSlope = 0.75;  // of swscale and of OpenCV

// Rounds the weights so that their sum is exact, by carrying the error on.
ChromaTaps rounded(int first, const std::array<double, 4>& weights, int bits) {
  double total = 0, error = 0;
  for (const double weight : weights) total += weight;
  ChromaTaps out{first, {}};
  for (std::size_t k = 0; k < 4; ++k) {
    const double exact = weights[k] / total * (1 << bits) + error;
    out.weight[k] = static_cast<int>(std::lround(exact));
    error = exact - out.weight[k];
  }
  return out;
}

// The weights of the four samples around a position in [0, 1) after the second.
std::array<float, 4> remap_weights(double position) {
  std::array<float, 4> out{};
  for (int k = 0; k < 4; ++k)
    out[static_cast<std::size_t>(k)] = static_cast<float>(cubic(position + 1 - k, kRemapSlope));
  return out;
}

}  // namespace

std::vector<ChromaTaps> chroma_taps(int pixels, ChromaSite site, int weight_bits) {
  const int samples = pixels / 2;
  const double shift = site == ChromaSite::kFirst ? 0 : site == ChromaSite::kBetween ? -0.25 : -0.5;
  std::vector<ChromaTaps> out;
  for (int i = 0; i < pixels; ++i) {
    const double at = 0.5 * i + shift;  // in samples
    const int begin = static_cast<int>(std::floor(at)) - 1;
    // swscale leaves out a sample that is farther than 1.5 before the first.
    const int limit = static_cast<int>(at - 1.5);
    const int first = std::clamp(begin, 0, samples - 4);
    std::array<double, 4> weights{};
    for (int k = std::max(begin, limit); k < begin + 4; ++k) {
      weights[static_cast<std::size_t>(std::clamp(k, 0, samples - 1) - first)] +=
          cubic(at - k, kScaleSlope);
    }
    out.push_back(rounded(first, weights, weight_bits));
  }
  return out;
}

std::vector<std::int16_t> warp_weights() {
  constexpr int kOne = 1 << kWarpWeightBits;
  std::vector<std::int16_t> out;
  for (int row = 0; row < kWarpSteps; ++row) {
    for (int column = 0; column < kWarpSteps; ++column) {
      const auto down = remap_weights(double(row) / kWarpSteps);
      const auto right = remap_weights(double(column) / kWarpSteps);
      std::array<int, kWarpTaps> weights{};
      int sum = 0;
      for (std::size_t k = 0; k < weights.size(); ++k) {
        const float exact = down[k / 4] * right[k % 4] * static_cast<float>(kOne);
        weights[k] = std::min(static_cast<int>(std::lrint(exact)), kOne - 1);
        sum += weights[k];
      }
      // The error of rounding goes to the largest of the four weights around the position if the
      // sum is too small, else to the smallest.
      std::array<int*, 4> central = {&weights[10], &weights[11], &weights[14], &weights[15]};
      const auto less = [](const int* a, const int* b) { return *a < *b; };
      int* const corrected = sum < kOne ? *std::max_element(central.begin(), central.end(), less)
                                        : *std::min_element(central.begin(), central.end(), less);
      *corrected -= sum - kOne;
      for (const int weight : weights) out.push_back(static_cast<std::int16_t>(weight));
    }
  }
  return out;
}

WarpPosition warp_position(float x, float y) {
  const auto steps = [](float value) {
    const float scaled = value * kWarpSteps;
    if (!(std::abs(scaled) < kFarAway)) return scaled > 0 ? kFarAway : -kFarAway;
    return static_cast<int>(std::lrint(scaled));
  };
  const int u = steps(x), v = steps(y);
  WarpPosition out{};
  out.x = static_cast<std::int16_t>(std::clamp(u >> 5, -32768, 32767));
  out.y = static_cast<std::int16_t>(std::clamp(v >> 5, -32768, 32767));
  out.weights = (v & 31) * kWarpSteps + (u & 31);
  return out;
}

std::vector<AreaSpan> area_spans(int from, int to) {
  const double scale = double(from) / to;
  std::vector<AreaSpan> out;
  for (int i = 0; i < to; ++i) {
    const double begin = i * scale, end = begin + scale;
    const double length = std::min(scale, from - begin);
    const int last = std::min(static_cast<int>(std::floor(end)), from - 1);
    const int first = std::min(static_cast<int>(std::ceil(begin)), last);
    AreaSpan span{first, last - first, float(1 / length), float(1 / length), float(1 / length)};
    if (first - begin > kMinShare) {
      --span.first;
      ++span.count;
      span.first_weight = float((first - begin) / length);
    }
    if (end - last > kMinShare) {
      ++span.count;
      span.last_weight = float(std::min(std::min(end - last, 1.0), length) / length);
      if (span.count == 1) span.first_weight = span.last_weight;
    }
    out.push_back(span);
  }
  return out;
}

}  // namespace stgs::encoder::geometry
