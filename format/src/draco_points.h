// SPDX-License-Identifier: Apache-2.0
// The coder of the profile `draco` (spec 7.2.1): positions as a Draco point cloud. Draco keeps no
// order of points, so records have theirs in ascending order of their Morton keys.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

// A value is an integer below 2^21 in this many digits of 8 bits, of each of 3 components.
inline constexpr std::size_t kDracoDigits = 3, kDracoComponents = 3;
inline constexpr std::size_t kDracoPlanes = kDracoDigits * kDracoComponents;
// As Draco counts: 0 (fewest bytes of large records) to 10. Decoding hardly depends on it.
inline constexpr int kDracoSpeed = 0;

// kNotBuilt where this build has no libdraco.
Status check_draco();

// The stored bytes of kDracoPlanes planes of n >= 1 symbols, whose points are in ascending order of
// their Morton keys. Throws where Draco fails.
std::vector<std::uint8_t> draco_encode(std::span<const std::uint8_t> planes, std::size_t n,
                                       int speed = kDracoSpeed);

// Whether the stored bytes state what they must, n points among it; reads 31 bytes and allocates
// nothing. Draco's decoder must see nothing else: it takes memory for what is stated there.
bool draco_fits(std::span<const std::uint8_t> stored, std::size_t n);
// The planes of what draco_fits(stored, n) accepts; what is wrong with it, or null.
const char* draco_decode(std::span<const std::uint8_t> stored, std::size_t n,
                         std::span<std::uint8_t> planes);

}  // namespace stgs
