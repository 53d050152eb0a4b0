// SPDX-License-Identifier: Apache-2.0
// Conversion of attributes to integers (spec 8.5), the inverse of the mappings of a decoder.
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
// kDisplacement: converts velocities. `part_exponent`: see part_exponent_of().
Integers displacement_integers(const Gaussians4D& part, Step step, int part_exponent);
// kShapedRotation: converts unit quaternions with w >= 0 of primitives with these log scales.
Integers rotation_integers(const Gaussians4D& part, const Integers& log_scales, Step step);
// kColour: converts each coefficient to luma and two chroma integers, centred at zero (spec 8.5).
Integers colour_integers(const Gaussians4D& part, Attribute attribute, Step step);
// kLinear: returns positions of `bits` bits per axis in Morton order, and sets `order` to it.
Integers position_integers(const Gaussians4D& part, Step step, const float (&origin)[3], int bits,
                           std::vector<std::uint32_t>& order);

}  // namespace stgs
