// SPDX-License-Identifier: Apache-2.0
// The cost of a hypothesis: how well the support of a pixel, mapped through the plane, correlates
// with the sources. The reference for the vectorised version, and the text of the CUDA kernel.
#pragma once

#include "geometry/stereo_problem.h"

namespace stgs::encoder::geometry {

// Pixels of a support along an axis, 2 pixels apart: -5, -3, .. 5.
inline constexpr int kSupportSide = 6;
inline constexpr int kSupportSize = kSupportSide * kSupportSide;
inline constexpr int kSupportStep = 2;
inline constexpr int kSupportReach = 5;

inline constexpr float kGreySigma = 12.0f;    // of the weights, grey levels
inline constexpr float kSpaceSigma = 5.0f;    // of the weights, pixels
inline constexpr float kTextureFloor = 4.0f;  // variance too small to correlate, grey levels^2
inline constexpr float kGreyShare = 0.3f;     // of the difference of the means in the cost
inline constexpr float kGreyScale = 40.0f;    // difference of the largest cost, grey levels
inline constexpr float kErrorLimit = 3.0f;    // largest reprojection error that counts, pixels
inline constexpr float kUnseen = 2.0f;        // cost of a hypothesis that no source sees

// Bilateral weights, which sum to 1, and the weighted grey values around a pixel.
struct Support {
  float weight[kSupportSize], weighted[kSupportSize];
  float mean, variance;
};

STGS_FN int support_offset(int i) {
  return kSupportStep * i - kSupportReach;
}

STGS_FN void load_support(const StereoImage& image, int x, int y, Support* support) {
  const float centre = grey_at(image, x, y);
  float sum = 0.0f, mean = 0.0f, square = 0.0f;
  for (int k = 0; k < kSupportSize; ++k) {
    const int dx = support_offset(k % kSupportSide), dy = support_offset(k / kSupportSide);
    const int px = x + dx, py = y + dy;
    support->weight[k] = support->weighted[k] = 0.0f;
    if (px < 0 || py < 0 || px >= image.width || py >= image.height) continue;
    const float value = grey_at(image, px, py);
    const float across = static_cast<float>(dx * dx + dy * dy) / (2.0f * kSpaceSigma * kSpaceSigma);
    const float weight = std::exp(-std::abs(value - centre) / kGreySigma - across);
    support->weight[k] = weight;
    support->weighted[k] = weight * value;
    sum += weight;
    mean += weight * value;
    square += weight * value * value;
  }
  const float unit = 1.0f / sum;
  for (int k = 0; k < kSupportSize; ++k) {
    support->weight[k] *= unit;
    support->weighted[k] *= unit;
  }
  support->mean = mean * unit;
  support->variance = math::larger(square * unit - support->mean * support->mean, 0.0f);
}

// Weighted sums over the values of a source, b, and of the reference, a.
struct SupportSums {
  float b, bb, ab;
};

// Cost in [0, 1] of a support with these sums.
STGS_FN float correlation_cost(const Support& support, SupportSums sums) {
  const float va = support.variance + kTextureFloor;
  const float vb = math::larger(sums.bb - sums.b * sums.b, 0.0f) + kTextureFloor;
  const float correlation = (sums.ab - support.mean * sums.b) / std::sqrt(va * vb);
  const float grey = math::smaller(1.0f, std::abs(support.mean - sums.b) / kGreyScale);
  return (1.0f - kGreyShare) * math::smaller(1.0f, 1.0f - correlation) + kGreyShare * grey;
}

// Bilinear grey value at image position (u, v), clamped to the image.
STGS_FN float grey_between(const StereoImage& image, float u, float v) {
  const float x = math::clamped(u - 0.5f, 0.0f, static_cast<float>(image.width - 1));
  const float y = math::clamped(v - 0.5f, 0.0f, static_cast<float>(image.height - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const std::uint32_t corners =
      image.corners[static_cast<std::size_t>(y0) * static_cast<std::size_t>(image.width) +
                    static_cast<std::size_t>(x0)];
  const auto corner = [corners](int k) { return static_cast<float>((corners >> (8 * k)) & 0xFFu); };
  const float above = corner(0) + ax * (corner(1) - corner(0));
  const float below = corner(2) + ax * (corner(3) - corner(2));
  return above + ay * (below - above);
}

// Returns whether the homography maps the pixel into the source.
STGS_FN bool is_seen(const StereoImage& source, const Mat3& h, float u, float v) {
  const float z = h.zx * u + h.zy * v + h.zz;
  const float x = h.xx * u + h.xy * v + h.xz, y = h.yx * u + h.yy * v + h.yz;
  return z > 1e-9f && x >= 0.0f && y >= 0.0f && x < z * static_cast<float>(source.width) &&
         y < z * static_cast<float>(source.height);
}

// Returns the sums over a support, mapped into a source by a homography.
STGS_FN SupportSums support_sums(const StereoImage& source, const Mat3& h, const Support& support,
                                 int x, int y) {
  SupportSums sums{0.0f, 0.0f, 0.0f};
  for (int k = 0; k < kSupportSize; ++k) {
    const float u = static_cast<float>(x + support_offset(k % kSupportSide)) + 0.5f;
    const float v = static_cast<float>(y + support_offset(k / kSupportSide)) + 0.5f;
    const float z = 1.0f / math::larger(h.zx * u + h.zy * v + h.zz, 1e-9f);
    const float b =
        grey_between(source, (h.xx * u + h.xy * v + h.xz) * z, (h.yx * u + h.yy * v + h.yz) * z);
    sums.b += support.weight[k] * b;
    sums.bb += support.weight[k] * b * b;
    sums.ab += support.weighted[k] * b;
  }
  return sums;
}

// Returns the cost of a hypothesis: the mean over the better half of the sources that see it.
STGS_FN float hypothesis_cost(const StereoProblem& problem, const Support& support, int x, int y,
                              Hypothesis plane) {
  const float u = static_cast<float>(x) + 0.5f, v = static_cast<float>(y) + 0.5f;
  const Vec3 row = plane_row(problem.reference, u, v, plane);
  float sorted[kMaxSources];
  int count = 0;
  for (int i = 0; i < problem.source_count; ++i) {
    const StereoSource& source = problem.sources[i];
    const Mat3 h = plane_homography(source, row);
    if (!is_seen(source.image, h, u, v)) continue;
    float cost = correlation_cost(support, support_sums(source.image, h, support, x, y));
    if (problem.consistency > 0.0f) {
      const float error =
          reprojection_error(problem.reference, source, u, v, plane.depth, kErrorLimit);
      cost += problem.consistency * math::smaller(error, kErrorLimit);
    }
    int j = count++;
    for (; j > 0 && sorted[j - 1] > cost; --j) sorted[j] = sorted[j - 1];
    sorted[j] = cost;
  }
  if (count == 0) return kUnseen;
  const int used = (count + 1) / 2;
  float sum = 0.0f;
  for (int i = 0; i < used; ++i) sum += sorted[i];
  return sum / static_cast<float>(used);
}

}  // namespace stgs::encoder::geometry
