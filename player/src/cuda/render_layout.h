// SPDX-License-Identifier: Apache-2.0
// The layout that a segment is drawn from: arrays of what is read together, in the order of use, so
// that a primitive costs the bytes up to the test that drops it. 80 to 168 bytes a primitive.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "cuda/device_gaussians.h"
#include "stgs/format/math/lang.h"

namespace stgs::player::cuda {

inline constexpr std::uint32_t kChunk = 256;  // primitives that are dealt with together

// Harmonics are half floats, four to a plane: entry i of plane p has numbers 4p to 4p + 3 of
// primitive i, counted as in Gaussians4D::sh. Colours are blended to within 2^-10 of each other.
STGS_FN constexpr int sh_planes(int sh_degree) {
  return (3 * (sh_degree + 1) * (sh_degree + 1) + 3) / 4;
}

STGS_FN constexpr std::uint32_t padded(std::uint32_t primitives) {
  return (primitives + kChunk - 1) / kChunk * kChunk;
}

// Device arrays of padded(N) entries, each behind the one before. Entries from N on have an empty
// support.
struct PackedSegment {
  float2* support;          // first and last moment at which it may be seen, ticks
  float4* place;            // position, time centre
  float4* motion;           // effective velocity, opacity
  float2* lifespan;         // sigma, radius
  float4* covariance;       // xx, xy, xz, yy
  float2* covariance_rest;  // yz, zz
  uint2* sh;                // sh_planes(degree) planes
};

constexpr std::size_t packed_bytes_each(int sh_degree) {
  return 72 + 8 * static_cast<std::size_t>(sh_planes(sh_degree));
}
// Bytes of the arrays of a segment of N primitives; a multiple of kChunk's alignment.
constexpr std::size_t packed_bytes(std::uint32_t primitives, int sh_degree) {
  return padded(primitives) * packed_bytes_each(sh_degree);
}
// The arrays of a segment in such memory, aligned as cudaMalloc aligns.
STGS_FN PackedSegment packed_at(std::uint8_t* memory, std::uint32_t primitives) {
  const std::size_t n = padded(primitives);
  PackedSegment out;
  out.support = reinterpret_cast<float2*>(memory);
  out.place = reinterpret_cast<float4*>(out.support + n);
  out.motion = out.place + n;
  out.lifespan = reinterpret_cast<float2*>(out.motion + n);
  out.covariance = reinterpret_cast<float4*>(out.lifespan + n);
  out.covariance_rest = reinterpret_cast<float2*>(out.covariance + n);
  out.sh = reinterpret_cast<uint2*>(out.covariance_rest + n);
  return out;
}

// Successive primitives of a segment.
struct PrimitiveRange {
  std::uint32_t first = 0, count = 0;  // first: a multiple of kChunk, as count where others follow
  std::uint32_t of = 0;                // primitives of the segment
};

// Starts filling a range of the arrays, from the `count` of `from`. Harmonics beyond a half float's
// range are cut to it: they are far beyond what a picture shows.
void pack_segment(const DeviceGaussians& from, const PrimitiveRange& range, int sh_degree,
                  const PackedSegment& to, cudaStream_t stream);

}  // namespace stgs::player::cuda
