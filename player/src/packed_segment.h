// SPDX-License-Identifier: Apache-2.0
// The memory layout of a segment for the shaders of Vulkan and of the browser, equal to that of
// cuda/render_layout.h: arrays of values that are read together, in the order of use. Each array
// has padded(N) entries; entries from N on are never active.
//   support           2 floats      first and last time at which it may be visible, ticks
//   position_time     4 floats      position, time centre
//   velocity_opacity  4 floats      effective velocity, opacity
//   lifespan          2 floats      sigma, radius
//   covariance        4 floats      xx, xy, xz, yy
//   covariance_rest   2 floats      yz, zz
//   sh                4 half floats, sh_planes times: numbers 4p to 4p + 3 of Gaussians4D::sh
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "stgs/format/gaussian4d.h"

namespace stgs::player {

// Entries of an array are padded to a multiple of this.
inline constexpr std::uint32_t kPackedGroup = 256;

// Returns the number of entries per array.
std::uint32_t padded(std::uint32_t primitives);
// Returns the bytes per primitive, 80 to 168.
std::uint64_t packed_bytes_each(int sh_degree);
// Returns the bytes of a segment.
std::uint64_t packed_bytes(std::uint32_t primitives, int sh_degree);

// Returns the bytes per primitive of each array, in their order.
std::vector<std::uint32_t> packed_widths(int sh_degree);

// Packs primitives [first, first + count) to the arrays at `to`, with their padding. SH missing
// from the set are 0; values beyond the range of half floats are clamped.
void pack_segment(const Gaussians4D& set, std::size_t first, std::uint32_t count, int sh_degree,
                  std::uint8_t* to);

}  // namespace stgs::player
