// SPDX-License-Identifier: Apache-2.0
// The position coder of the draco profile (spec, annex C). Draco does not preserve the order of
// points, so records store them in ascending order of Morton key.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

// A value is an integer below 2^21, in three digits of 8 bits, for each of three components.
inline constexpr std::size_t kDracoDigits = 3, kDracoComponents = 3;
inline constexpr std::size_t kDracoPlanes = kDracoDigits * kDracoComponents;
// Draco's speed setting, 0 (smallest for large records) to 10. It hardly affects decoding.
inline constexpr int kDracoSpeed = 0;

// Returns kNotBuilt if this build has no libdraco.
Status check_draco();

// Encodes kDracoPlanes planes of n >= 1 symbols, whose points are in ascending order of Morton key.
// Throws if Draco fails.
std::vector<std::uint8_t> draco_encode(std::span<const std::uint8_t> planes, std::size_t n,
                                       int speed = kDracoSpeed);

// Returns whether the header of the stored bytes has the required form and n points. Reads 31 bytes
// and allocates nothing. Always check this before decoding: Draco allocates what the header states.
bool draco_fits(std::span<const std::uint8_t> stored, std::size_t n);
// Decodes bytes accepted by draco_fits(stored, n) into planes. Returns the problem, or null.
const char* draco_decode(std::span<const std::uint8_t> stored, std::size_t n,
                         std::span<std::uint8_t> planes);

}  // namespace stgs
