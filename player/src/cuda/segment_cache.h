// SPDX-License-Identifier: Apache-2.0
// The segments of a timeline that are on the device, decoded there and laid out to be drawn.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "cuda/device_buffer.h"
#include "cuda/render_layout.h"
#include "cuda/segment_decode.h"
#include "stgs/player/timeline.h"

namespace stgs::player::cuda {

// One thread; the current device.
class SegmentCache {
 public:
  SegmentCache() = default;
  SegmentCache(const SegmentCache&) = delete;
  SegmentCache& operator=(const SegmentCache&) = delete;
  ~SegmentCache() { clear(); }

  Status create();
  // Makes the segments present, and drops those needed least recently where the timeline's budget
  // asks for it; what is held of another timeline goes. What uses segments must have ended. Waits
  // for what it decodes. Errors: those of Timeline::at. A segment may turn out to be lost: ask
  // Timeline::needed_at again.
  Status hold(Timeline& timeline, std::span<const Timeline::Needed> needed, double seconds);
  // One that the last call of hold() named, and that is not lost.
  const PackedSegment& at(std::uint32_t segment) const { return held_.at(segment).packed; }
  bool holds(std::uint32_t segment) const { return held_.contains(segment); }
  std::uint64_t stored_primitives() const { return primitives_; }

 private:
  struct Held {
    PackedSegment packed;
    void* memory = nullptr;
    std::uint64_t bytes = 0;
    std::uint32_t primitives = 0;
    std::uint64_t used = 0;                // number of the call that needed it last
    std::weak_ptr<const Gaussians4D> set;  // Timeline::Needed's, where it had one
  };
  using Segments = std::map<std::uint32_t, Held>;

  void clear();
  void drop(Segments::iterator segment);
  // Whether it is held as it is needed; where it has changed it is dropped.
  bool has(const Timeline::Needed& needed);
  Status begin(const Timeline& timeline);
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments);
  Status decode_batch(Timeline& timeline, std::span<const CodedSegment> coded,
                      std::span<const std::uint32_t> segments);
  // Starts and awaits the decoding of segments into `fresh`, for which it takes memory; which of
  // them are sound.
  Result<std::vector<bool>> decode_into(std::span<Held> fresh, std::span<const CodedSegment> coded);
  // One that the GPU cannot decode, by the processor, as the timeline wants damage dealt with.
  Status decode_here(Timeline& timeline, std::uint32_t segment);
  // Sends one that is decoded, and waits for it.
  Status send(const Gaussians4D& set, Held& held);
  void keep(std::uint32_t segment, const Held& held);
  Status allocate(std::uint32_t primitives, Held& held);

  Stream stream_;
  MemoryPool pool_;
  SegmentDecoder decoder_;
  DeviceBuffer floats_;  // of the batch that is decoded
  std::weak_ptr<const void> timeline_;
  int sh_degree_ = 0;
  Segments held_;
  std::uint64_t bytes_ = 0, primitives_ = 0, call_ = 0;
};

}  // namespace stgs::player::cuda
