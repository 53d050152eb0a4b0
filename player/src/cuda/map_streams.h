// SPDX-License-Identifier: Apache-2.0
// Converts the planes of a segment to floats on an NVIDIA GPU, bit-identical to the decoder of
// format (spec 8). Nothing here allocates or waits.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "cuda/device_gaussians.h"
#include "stgs/format/coded_segment.h"

namespace stgs::player::cuda {

inline constexpr std::uint32_t kMapChunk = 1024;  // values per thread block

// A plane of digits, in device memory.
struct MapPlane {
  const std::uint8_t* symbols = nullptr;  // one per value; null: all are `only`
  std::uint32_t only = 0;
};

// A stream of a segment. Pointers are device addresses.
struct MapJob {
  const MapPlane* planes = nullptr;        // components x digits, then 3 x low_digits
  float* to = nullptr;                     // component c of primitive i is to[i * stride + c]
  const std::uint32_t* members = nullptr;  // the primitive of each value; null: they are the same
  // Integers of each primitive on which other streams depend: the bits b of sigma and radius (spec
  // 8.6), the spread of the log scales (spec 8.8). `keep`: where this stream leaves its own; null
  // unless it is one of the three.
  const std::uint32_t *sigma = nullptr, *radius = nullptr, *spread = nullptr;
  std::uint32_t* keep = nullptr;
  // Per chunk and component, the sum of the differences, later of all chunks before; null if the
  // prediction does not sum.
  std::uint32_t* sums = nullptr;
  std::uint32_t* is_invalid = nullptr;  // set to 1 if a value must be rejected
  std::uint32_t first_key = 0;
  float origin[3] = {0, 0, 0};
  float time_base = 0;  // of times, ticks
  int part_exponent = 0;
  std::uint32_t shape_bounds[6] = {};
  std::uint32_t values = 0, chunks = 0;
  Step step;
  std::uint32_t max_steps = 0;  // limit of |q|
  std::uint32_t components = 0, stride = 0, digits = 0;
  std::uint32_t low = 0, low_digits = 0;  // of positions
  std::uint32_t width = 1;                // components that are mapped together
  Attribute attribute = Attribute::kPosition;
  Mapping mapping = Mapping::kFloat;
  Prediction prediction = Prediction::kPlain;
  std::uint8_t digit_bits[kMaxDigits] = {};
};

// A chunk of a stream's components [component, component + width); for sums, of one component.
struct MapWork {
  std::uint32_t job = 0, chunk = 0, component = 0;
};

constexpr std::uint32_t map_chunks(std::uint32_t values) {
  return (values + kMapChunk - 1) / kMapChunk;
}

// Starts summing the differences of `count` works, then prefix sums over the chunks of each of the
// `jobs_summed` jobs with indices `summed`.
void sum_differences(const MapJob* jobs, const MapWork* work, std::uint32_t count,
                     const std::uint32_t* summed, std::uint32_t jobs_summed, cudaStream_t stream);
// Memory to clear, on the device; 16-byte aligned.
struct ClearJob {
  float* to = nullptr;
  std::uint64_t floats = 0;
};
// Starts clearing `count` ranges.
void clear_ranges(const ClearJob* jobs, std::uint32_t count, cudaStream_t stream);
// Starts mapping `count` works.
void map_streams(const MapJob* jobs, const MapWork* work, std::uint32_t count, cudaStream_t stream);

// Primitives that end, of a decoded segment. Pointers are device addresses.
struct EndJob {
  DeviceGaussians set;
  const CodedEnd* ends = nullptr;
  std::uint32_t count = 0;
  float begin = 0;  // of the part, in the times of the set
};
// Starts applying the ends of `count` jobs, as stgs::apply_ends() does.
void apply_ends(const EndJob* jobs, std::uint32_t count, cudaStream_t stream);

}  // namespace stgs::player::cuda
