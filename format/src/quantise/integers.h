// SPDX-License-Identifier: Apache-2.0
// Conversion of attributes to integers (spec 7.5), the inverse of the mappings of a decoder.
#pragma once

#include <cstdint>
#include <vector>

#include "codec/stream.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// kLinear and kTime: converts an attribute to steps.
Integers linear_integers(const Gaussians4D& part, Attribute attribute, Mapping mapping, Step step);
// kTime: converts T to steps from the beginning of the segment, ticks of its part.
Integers time_integers(const Gaussians4D& part, Step step, double segment_begin);
// kTruncated: converts values plus `offset` to units in the last place.
Integers truncated_integers(const Gaussians4D& part, Attribute attribute, Step step, float offset);
// kDisplacement: converts velocities in a part of `part_ticks`.
Integers displacement_integers(const Gaussians4D& part, Step step, float part_ticks);
// kShapedRotation: converts unit quaternions with w >= 0. `shapes`: log scales as reconstructed by
// a decoder.
Integers rotation_integers(const Gaussians4D& part, const std::vector<float>& shapes, Step step);
// kColour: converts each coefficient to luma and two chroma integers, centred at zero (spec 7.5.6).
Integers colour_integers(const Gaussians4D& part, Attribute attribute, Step step);
// kLinear: returns positions as Morton keys, and sets `order` to the order of ascending keys.
Integers position_integers(const Gaussians4D& part, Step step, const float (&origin)[3],
                           std::vector<std::uint32_t>& order);

// Returns the log scales that a decoder reconstructs from these integers.
std::vector<float> decoded_log_scales(const Integers& integers);

}  // namespace stgs
