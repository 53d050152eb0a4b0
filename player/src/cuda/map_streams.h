// SPDX-License-Identifier: Apache-2.0
// Planes of a segment to floats on an NVIDIA GPU, to the bits of format's decoder (spec 7.3
// to 7.5). Nothing here allocates or waits.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "stgs/format/coded_segment.h"

namespace stgs::player::cuda {

inline constexpr std::uint32_t kMapChunk = 1024;  // primitives of a thread block

// Pointers are the device's.
struct MapPlane {
  const std::uint8_t* symbols = nullptr;  // of all primitives; null: `only` for each of them
  std::uint32_t only = 0;
};

// A stream of a segment.
struct MapJob {
  const MapPlane* planes = nullptr;  // components x digits
  float* to = nullptr;               // component c of primitive i is to[i * stride + c]
  // What displacements and shaped rotations need, decoded.
  const float *sigma = nullptr, *radius = nullptr, *log_scale = nullptr;
  // Of each chunk and component the sum of the differences, then of those of all chunks before;
  // null where the prediction sums nothing.
  std::uint64_t* sums = nullptr;
  std::uint32_t* bad = nullptr;  // set to 1 where a value is one that must be refused
  std::uint64_t first_key = 0;
  float origin[3] = {0, 0, 0};
  float part_ticks = 0;
  std::int32_t time_origin = 0;
  std::uint32_t primitives = 0, chunks = 0;
  Step step;
  std::uint32_t most = 0;  // of |q|
  std::uint32_t components = 0, stride = 0, digits = 0;
  std::uint32_t width = 1;  // components that make floats together
  Attribute attribute = Attribute::kPosition;
  Mapping mapping = Mapping::kFloat;
  Prediction prediction = Prediction::kPlain;
  std::uint8_t digit_bits[kMaxDigits] = {};
};

// A chunk of a stream's components [component, component + width); for sums, of one component.
struct MapWork {
  std::uint32_t job = 0, chunk = 0, component = 0;
};

constexpr std::uint32_t map_chunks(std::uint32_t primitives) {
  return (primitives + kMapChunk - 1) / kMapChunk;
}

// Starts the sums of `count` works, of jobs with sums, and then those of the chunks before, job
// after job: the `summed` numbers of the jobs that have them.
void sum_differences(const MapJob* jobs, const MapWork* work, std::uint32_t count,
                     const std::uint32_t* summed, std::uint32_t jobs_summed, cudaStream_t stream);
// Starts the mapping of `count` works.
void map_streams(const MapJob* jobs, const MapWork* work, std::uint32_t count, cudaStream_t stream);

}  // namespace stgs::player::cuda
