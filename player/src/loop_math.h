// SPDX-License-Identifier: Apache-2.0
// Elementary functions without branches, for loops that the compiler vectorises. All machines
// without fused multiply-adds give the same results.
#pragma once

#include <bit>
#include <cstdint>

#include "stgs/format/math/lang.h"

namespace stgs::player {

// Returns e^x with a relative error of at most 1.2e-7. x is clamped to [-87, 88]; NaN stays NaN.
inline float exp_of(float x) {
  // Polynomial of (e^r - 1 - r) / r^2 for |r| <= ln(2) / 2.
  constexpr float kTerms[] = {0.5f, 0.166665463f, 0.0416664139f, 0.00836708437f, 0.00139382922f};
  constexpr float kLog2E = 1.44269504f;
  // ln(2), whose first part has 10 bits, so that its multiples are exact.
  constexpr float kLn2High = 0.693359375f, kLn2Low = -2.12194440e-4f;
  constexpr float kMagic = 12582912.0f;  // adding it puts the nearest integer into the low bits
  x = math::smaller(88.0f, math::larger(-87.0f, x));
  const float shifted = x * kLog2E + kMagic;
  const float n = shifted - kMagic;
  const float r = x - n * kLn2High - n * kLn2Low;
  float sum = kTerms[4];
  for (int k = 3; k >= 0; --k) sum = sum * r + kTerms[k];
  const float y = sum * (r * r) + r + 1.0f;
  return std::bit_cast<float>(std::bit_cast<std::uint32_t>(y) +
                              (std::bit_cast<std::uint32_t>(shifted) << 23));
}

// Returns ln(x) of a normal x > 0, with an error of at most 1.2e-7 max(1, |ln(x)|); unspecified for
// other x.
inline float log_of(float x) {
  // Polynomial of (ln(1 + f) - f + f^2 / 2) / f^3 for 1 + f from sqrt(1/2) to sqrt(2).
  constexpr float kTerms[] = {0.333334416f, -0.250014328f, 0.199818631f, -0.165707229f,
                              0.147075675f, -0.143221431f, 0.0940350921f};
  constexpr float kLn2 = 0.693147182f;
  constexpr std::int32_t kSqrtHalf = 0x3F3504F3;
  const auto bits = std::bit_cast<std::int32_t>(x);
  const std::int32_t exponent = (bits - kSqrtHalf) >> 23;
  const float f =
      std::bit_cast<float>(static_cast<std::int32_t>(
          static_cast<std::uint32_t>(bits) - (static_cast<std::uint32_t>(exponent) << 23))) -
      1.0f;
  const float square = f * f;
  float sum = kTerms[6];
  for (int k = 5; k >= 0; --k) sum = sum * f + kTerms[k];
  return sum * f * square - 0.5f * square + f + static_cast<float>(exponent) * kLn2;
}

// Returns the bits of the nearest half float, ties to even. Values beyond the range of half floats
// are clamped; those that are not finite stay so.
inline std::uint16_t half_bits(float x) {
  // Signed numbers, which vector units compare faster.
  constexpr std::int32_t kInfinity = 0x7F800000, kMaxHalf = 0x477FE000;  // 65504
  constexpr std::int32_t kMinNormal = 0x38800000;                        // 2^-14
  const auto bits = std::bit_cast<std::int32_t>(x);
  const std::int32_t magnitude = bits & 0x7FFFFFFF;
  const std::int32_t clamped = magnitude < kMaxHalf ? magnitude : kMaxHalf;
  const std::int32_t normal = ((clamped + 0xFFF + (clamped >> 13 & 1)) >> 13) - (112 << 10);
  // Adding 0.5 rounds to the precision of subnormal half floats.
  const std::int32_t small =
      std::bit_cast<std::int32_t>(std::bit_cast<float>(clamped) + 0.5f) - 0x3F000000;
  const std::int32_t infinite = magnitude > kInfinity ? 0x7E00 : 0x7C00;
  const std::int32_t finite = clamped < kMinNormal ? small : normal;
  return static_cast<std::uint16_t>((bits >> 16 & 0x8000) |
                                    (magnitude < kInfinity ? finite : infinite));
}

}  // namespace stgs::player
