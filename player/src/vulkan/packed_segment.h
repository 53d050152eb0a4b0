// SPDX-License-Identifier: Apache-2.0
// The layout that shaders draw primitives from, that of cuda/render_layout.h: arrays of what is
// read together, in the order of use. Each has padded(N) entries; those from N on are never alive.
//   support          2 floats      first and last moment at which it may be seen, ticks
//   place            4 floats      position, time centre
//   motion           4 floats      effective velocity, opacity
//   lifespan         2 floats      sigma, radius
//   covariance       4 floats      xx, xy, xz, yy
//   covariance_rest  2 floats      yz, zz
//   harmonics        4 half floats, sh_planes times: numbers 4p to 4p + 3 of Gaussians4D::sh
#pragma once

#include <cstddef>
#include <cstdint>

#include "stgs/format/gaussian4d.h"

namespace stgs::player::vulkan {

std::uint32_t padded(std::uint32_t primitives);
// Of a primitive; 80 to 168.
std::uint64_t packed_bytes_each(int sh_degree);
std::uint64_t packed_bytes(std::uint32_t primitives, int sh_degree);

// Fills the arrays from primitives [first, first + count); harmonics that the set lacks are 0, and
// those beyond a half float's range are cut to it.
void pack_segment(const Gaussians4D& set, std::size_t first, std::uint32_t count, int sh_degree,
                  std::uint8_t* to);

}  // namespace stgs::player::vulkan
