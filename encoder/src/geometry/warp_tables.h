// SPDX-License-Identifier: Apache-2.0
// The tables of warp_rule.h.
#pragma once

#include <vector>

#include "geometry/warp_rule.h"

namespace stgs::encoder::geometry {

// Where a chroma sample lies along an axis, relative to the two pixels that it covers.
enum class ChromaSite { kFirst, kBetween, kSecond };

inline constexpr int kColumnWeightBits = 14, kRowWeightBits = 12;
// swscale has other taps for images of fewer columns or rows.
inline constexpr int kMinYuvSide = 16;

// Returns the taps of an axis with so many pixels, an even number from kMinYuvSide on.
// `weight_bits`: of the sum of the weights.
std::vector<ChromaTaps> chroma_taps(int pixels, ChromaSite site, int weight_bits);

// Returns the weights of all positions between samples, for warped_sample().
std::vector<std::int16_t> warp_weights();

// Returns the position of the source (x, y), pixels with integer centres.
WarpPosition warp_position(float x, float y);

// Returns the spans of an axis that is scaled from `from` to `to` samples, to <= from.
std::vector<AreaSpan> area_spans(int from, int to);

}  // namespace stgs::encoder::geometry
