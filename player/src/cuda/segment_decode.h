// SPDX-License-Identifier: Apache-2.0
// Decodes segments on an NVIDIA GPU: rANS groups, predictions and mappings, to the bits of format's
// decoder (spec 7). What is not rANS has been decompressed when the segment was read.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>
#include <vector>

#include "cuda/device_buffer.h"
#include "cuda/device_gaussians.h"
#include "cuda/map_streams.h"
#include "cuda/rans_decode.h"
#include "stgs/format/coded_segment.h"
#include "stgs/format/status.h"

namespace stgs::player::cuda {

// One thread at a time, with the device current that it was made for.
class SegmentDecoder {
 public:
  SegmentDecoder() = default;
  SegmentDecoder(const SegmentDecoder&) = delete;
  SegmentDecoder& operator=(const SegmentDecoder&) = delete;

  // The tables that the records of segments name (SceneReader::tables), from now on. Waits.
  Status set_tables(std::span<const RansLookup> tables);
  // Makes the plan for segments, each to the arrays of the same number; harmonics that it lacks are
  // to be 0. The segments need not outlive the call. Not while a launch is under way. An error
  // (kRuntime) where the device has no memory left.
  Status prepare(std::span<const CodedSegment* const> segments,
                 std::span<const DeviceGaussians> to);
  // Starts what was prepared: sends it, and the kernels.
  Status launch(cudaStream_t stream);
  // Waits for what launch() began: for each segment whether it is sound. One that is not (its rANS
  // blocks end wrong, an integer is out of range, or a primitive cannot be drawn) must not be used.
  Result<std::vector<bool>> finish();

 private:
  // What the kernels are given, on the device.
  struct Launch {
    const RansGroup* groups = nullptr;
    const RansWork* rans = nullptr;
    const MapJob* jobs = nullptr;
    const MapWork* sums = nullptr;
    const std::uint32_t* summed = nullptr;  // jobs with sums
    const MapWork* maps[2] = {};            // those that need others come second
    std::uint32_t rans_count = 0, sum_count = 0, summed_count = 0, map_count[2] = {};
    std::size_t upload = 0;  // bytes
  };
  struct Cleared {
    float* at = nullptr;
    std::size_t bytes = 0;
  };
  class Plan;

  cudaStream_t stream_ = nullptr;
  std::size_t segments_ = 0;
  Launch launch_;
  std::vector<Cleared> cleared_;
  DeviceBuffer tables_, input_, scratch_, flags_;
  PinnedBuffer staging_, found_;
};

}  // namespace stgs::player::cuda
