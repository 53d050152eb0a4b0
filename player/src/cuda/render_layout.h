// SPDX-License-Identifier: Apache-2.0
// The memory layout of a segment for rendering: arrays of values that are read together, in the
// order of use, so that a rejected primitive costs only the bytes up to the test that rejects it.
// 80 to 168 bytes per primitive.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "cuda/device_gaussians.h"
#include "stgs/format/math/lang.h"

namespace stgs::player::cuda {

inline constexpr std::uint32_t kChunk = 256;  // primitives per chunk

// Spherical harmonics are half floats, four per plane: entry i of plane p has numbers 4p to 4p + 3
// of primitive i, counted as in Gaussians4D::sh. Colours are accurate to within 2^-10.
STGS_FN constexpr int sh_planes(int sh_degree) {
  return (3 * (sh_degree + 1) * (sh_degree + 1) + 3) / 4;
}

STGS_FN constexpr std::uint32_t padded(std::uint32_t primitives) {
  return (primitives + kChunk - 1) / kChunk * kChunk;
}

// Contiguous device arrays of padded(N) entries each. Entries from N on have an empty support.
struct PackedSegment {
  float2* support;           // first and last time at which it may be visible, ticks
  float4* position_time;     // position, time centre
  float4* velocity_opacity;  // effective velocity, opacity
  float2* lifespan;          // sigma, radius
  float4* covariance;        // xx, xy, xz, yy
  float2* covariance_rest;   // yz, zz
  uint2* sh;                 // sh_planes(degree) planes
};

constexpr std::size_t packed_bytes_each(int sh_degree) {
  return 72 + 8 * static_cast<std::size_t>(sh_planes(sh_degree));
}
// Returns the bytes of a segment, a multiple of kChunk.
constexpr std::size_t packed_bytes(std::uint32_t primitives, int sh_degree) {
  return padded(primitives) * packed_bytes_each(sh_degree);
}
// Returns the arrays in memory of packed_bytes(), aligned as cudaMalloc aligns.
STGS_FN PackedSegment packed_at(std::uint8_t* memory, std::uint32_t primitives) {
  const std::size_t n = padded(primitives);
  PackedSegment out;
  out.support = reinterpret_cast<float2*>(memory);
  out.position_time = reinterpret_cast<float4*>(out.support + n);
  out.velocity_opacity = out.position_time + n;
  out.lifespan = reinterpret_cast<float2*>(out.velocity_opacity + n);
  out.covariance = reinterpret_cast<float4*>(out.lifespan + n);
  out.covariance_rest = reinterpret_cast<float2*>(out.covariance + n);
  out.sh = reinterpret_cast<uint2*>(out.covariance_rest + n);
  return out;
}

// Successive primitives of a segment.
struct PrimitiveRange {
  std::uint32_t first = 0, count = 0;  // multiples of kChunk, except the last count
  std::uint32_t of = 0;                // primitives in the segment
};

// Starts filling a range of the arrays from the first `count` entries of `from`. Spherical
// coefficients beyond the range of half floats are clamped, which is far beyond displayable
// colours.
void pack_segment(const DeviceGaussians& from, const PrimitiveRange& range, int sh_degree,
                  const PackedSegment& to, cudaStream_t stream);

}  // namespace stgs::player::cuda
