// SPDX-License-Identifier: Apache-2.0
// Decodes groups of rANS-coded planes on an NVIDIA GPU, to the bytes of format's decoder (spec
// annex A), those of damaged groups included. Nothing here allocates or waits.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>
#include <vector>

#include "stgs/format/rans_layout.h"

namespace stgs::player::cuda {

inline constexpr std::uint32_t kRansWarps = 8;  // of a thread block; each decodes a block

// A group; its pointers are the device's.
struct RansGroup {
  const std::uint8_t* bytes = nullptr;        // as rans_layout has checked them; an even address
  const RansBlockLocation* blocks = nullptr;  // what rans_layout gave for them
  const std::uint32_t* lookups = nullptr;  // tables x 4096, each a RansLookup; aligned to 16 bytes
  const std::uint16_t* tables = nullptr;   // by plane, numbers of `lookups`
  std::uint8_t* symbols = nullptr;         // decoded to: planes x primitives
  std::uint32_t* damaged = nullptr;        // 1 is added for each block that ends as none may
  std::uint32_t primitives = 0, planes = 0;
};

// What a thread block does: up to kRansWarps blocks of a group, which share its tables.
struct RansWork {
  std::uint32_t group = 0;
  std::uint32_t first_block = 0;
};

// The work of groups of so many primitives, in their order.
std::vector<RansWork> rans_work(std::span<const std::uint32_t> primitives);

// Starts the decoding of `count` works; groups and work are the device's. An error of the launch is
// cudaGetLastError's.
void decode_rans(const RansGroup* groups, const RansWork* work, std::uint32_t count,
                 cudaStream_t stream);

}  // namespace stgs::player::cuda
