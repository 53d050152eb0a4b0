// SPDX-License-Identifier: Apache-2.0
// Decodes segments on an NVIDIA GPU: rANS groups, predictions and mappings, bit-identical to the
// decoder of format (spec 7, 8). Positions coded by Draco are decoded when the segment is read.
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

// One thread at a time, always with the same current device.
class SegmentDecoder {
 public:
  // `memory` as for GrowingBuffer.
  explicit SegmentDecoder(RendererMemory* memory = nullptr)
      : tables_(memory),
        input_(memory),
        scratch_(memory),
        flags_(memory),
        staging_(memory),
        host_flags_(memory) {}
  SegmentDecoder(const SegmentDecoder&) = delete;
  SegmentDecoder& operator=(const SegmentDecoder&) = delete;

  // Sets the tables that the records of segments refer to (SceneReader::tables), in the order of
  // the stream, which launch() has to get, too. They must stay valid until the stream
  // has passed the copy.
  Status set_tables(std::span<const RansLookup> tables, cudaStream_t stream);
  // Prepares the decoding of segments[i] to to[i]. Missing spherical harmonics become 0. The
  // segments need not outlive the call. No launch may be in flight. kNoMemory if the device is out
  // of memory.
  Status prepare(std::span<const CodedSegment* const> segments,
                 std::span<const DeviceGaussians> to);
  // Starts the prepared decoding: enqueues uploads and kernels.
  Status launch(cudaStream_t stream);
  // Waits for launch() and returns for each segment whether it is intact. One that is not must not
  // be used: its rANS blocks end in an invalid state, an integer is out of range, or a primitive is
  // invalid.
  Result<std::vector<bool>> finish();

 private:
  // The arguments of the kernels, in device memory.
  struct Launch {
    const ClearJob* clears = nullptr;
    const RansGroup* groups = nullptr;
    const RansWork* rans = nullptr;
    const MapJob* jobs = nullptr;
    const MapWork* sums = nullptr;
    const std::uint32_t* summed = nullptr;  // indices of jobs with sums
    const MapWork* maps[2] = {};            // streams that depend on others come second
    const EndJob* ends = nullptr;
    std::uint32_t end_count = 0, clear_count = 0, rans_count = 0, sum_count = 0, summed_count = 0,
                  map_count[2] = {};
    std::size_t upload = 0;  // bytes
  };
  class Plan;

  cudaStream_t stream_ = nullptr;
  std::size_t segments_ = 0;
  Launch launch_;
  DeviceBuffer tables_, input_, scratch_, flags_;
  PinnedBuffer staging_, host_flags_;
};

}  // namespace stgs::player::cuda
