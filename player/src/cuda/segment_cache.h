// SPDX-License-Identifier: Apache-2.0
// The segments that are resident on the CUDA device, which also decodes them.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "cuda/device_buffer.h"
#include "cuda/host_staging.h"
#include "cuda/render_layout.h"
#include "cuda/segment_decode.h"
#include "device_segments.h"

namespace stgs::player::cuda {

// One thread; the current device.
class SegmentCache final : public DeviceSegments {
 public:
  // `memory` as for GrowingBuffer, for decoding and uploads.
  explicit SegmentCache(RendererMemory* memory)
      : decoder_(memory), floats_(memory), staging_(memory) {}
  SegmentCache(const SegmentCache&) = delete;
  SegmentCache& operator=(const SegmentCache&) = delete;
  ~SegmentCache() override { clear(); }

  Status create();
  // Returns the memory of a segment that the last make_resident() returned, for packed_at().
  std::uint8_t* at(std::uint32_t segment) const { return resident_.at(segment); }

 private:
  Status begin(const SceneReader& reader) override;
  void reserve(std::uint64_t bytes) override;
  std::uint64_t bytes_of(std::uint64_t primitives) const override;
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) override;
  Status upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) override;
  void cancel_upload(std::uint32_t segment) override;
  void release(std::uint32_t segment) override;

  Status decode_batch(Timeline& timeline, std::span<const CodedSegment> coded,
                      std::span<const std::uint32_t> segments);
  // Allocates memory for segments, decodes them and waits. Returns which of them are intact.
  Result<std::vector<bool>> decode_into(std::span<std::uint8_t*> fresh,
                                        std::span<const CodedSegment> coded);
  // Uploads a range of a set and starts packing it into `fresh`.
  Status upload_range(const Gaussians4D& set, const PrimitiveRange& range, std::uint8_t* fresh);
  Status allocate(std::uint32_t primitives, std::uint8_t*& fresh);
  void free(std::uint8_t* memory);
  void replace(std::uint32_t segment, const CodedSegment& coded, std::uint8_t* fresh);

  Stream stream_;
  MemoryPool pool_;
  SegmentDecoder decoder_;
  DeviceBuffer floats_;  // of a decoded batch, or of an uploaded range
  HostStaging staging_;
  std::map<std::uint32_t, std::uint8_t*> resident_, incomplete_;
};

}  // namespace stgs::player::cuda
