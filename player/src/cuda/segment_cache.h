// SPDX-License-Identifier: Apache-2.0
// The segments of a timeline that are on the device, decoded there and laid out to be drawn.
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
  SegmentCache() = default;
  SegmentCache(const SegmentCache&) = delete;
  SegmentCache& operator=(const SegmentCache&) = delete;
  ~SegmentCache() override { clear(); }

  Status create();
  // The memory of one that the last call of make_resident() gave, for packed_at().
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
  // Starts and awaits the decoding of segments into `fresh`, for which it takes memory; which of
  // them are sound.
  Result<std::vector<bool>> decode_into(std::span<std::uint8_t*> fresh,
                                        std::span<const CodedSegment> coded);
  Status lay_out(const Gaussians4D& set, const PrimitiveRange& range, std::uint8_t* fresh);
  Status allocate(std::uint32_t primitives, std::uint8_t*& fresh);
  void give_back(std::uint8_t* memory);
  void take_in(std::uint32_t segment, std::uint64_t primitives, std::uint8_t* fresh);

  Stream stream_;
  MemoryPool pool_;
  SegmentDecoder decoder_;
  DeviceBuffer floats_;  // of the batch that is decoded, or the range that is sent
  HostStaging staging_;
  std::map<std::uint32_t, std::uint8_t*> resident_, arriving_;
};

}  // namespace stgs::player::cuda
