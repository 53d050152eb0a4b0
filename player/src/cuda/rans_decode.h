// SPDX-License-Identifier: Apache-2.0
// Decodes groups of rANS-coded planes on an NVIDIA GPU, bit-identical to the decoder of format
// (spec annex A), also for damaged groups. Nothing here allocates or waits.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>
#include <vector>

#include "stgs/format/rans_layout.h"

namespace stgs::player::cuda {

inline constexpr std::uint32_t kRansWarps = 8;  // per thread block; each decodes one rANS block

// A group. Pointers are device addresses.
struct RansGroup {
  const std::uint8_t* bytes = nullptr;        // checked by rans_layout; an even address
  const RansBlockLocation* blocks = nullptr;  // as rans_layout returns them
  const std::uint32_t* lookups = nullptr;  // tables x 4096, each a RansLookup; aligned to 16 bytes
  const std::uint16_t* tables = nullptr;   // index into `lookups`, per plane
  std::uint8_t* symbols = nullptr;         // decoded to: planes x count
  std::uint32_t* damaged = nullptr;     // incremented for each block that ends in an invalid state
  std::uint32_t count = 0, planes = 0;  // symbols per plane, planes
};

// The work of a thread block: up to kRansWarps rANS blocks of a group, which share its tables.
struct RansWork {
  std::uint32_t group = 0;
  std::uint32_t first_block = 0;
};

// Returns the work for groups with the given numbers of symbols per plane, in order.
std::vector<RansWork> rans_work(std::span<const std::uint32_t> counts);

// Starts decoding `count` works. `groups` and `work` are device addresses. Launch errors are
// reported by cudaGetLastError().
void decode_rans(const RansGroup* groups, const RansWork* work, std::uint32_t count,
                 cudaStream_t stream);

}  // namespace stgs::player::cuda
