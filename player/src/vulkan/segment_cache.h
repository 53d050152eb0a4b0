// SPDX-License-Identifier: Apache-2.0
// The segments of a timeline that are on the device, laid out to be drawn.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "stgs/player/timeline.h"
#include "vulkan/buffer.h"
#include "vulkan/segment_memory.h"

namespace stgs::player::vulkan {

// Primitives of a segment, successive ones, that lie in one block.
struct Piece {
  Room room;
  std::uint32_t primitives = 0;
};

// One thread; the device outlives it.
class SegmentCache {
 public:
  // `block_bytes`: of a block, 0 for as much as is good for the device.
  void create(Device& device, std::uint64_t block_bytes);
  // Makes the segments present, and drops those needed least recently where the timeline's budget
  // asks for it; what is held of another timeline goes. What uses segments must have ended. Waits
  // for what it sends. Errors: those of Timeline::at. A segment may turn out to be lost: ask
  // Timeline::needed_at again.
  Status hold(Timeline& timeline, std::span<const Timeline::Needed> needed, double seconds);
  // Of one that the last call of hold() named, and that is not lost.
  const std::vector<Piece>& at(std::uint32_t segment) const { return held_.at(segment).pieces; }
  bool holds(std::uint32_t segment) const { return held_.contains(segment); }
  const SegmentMemory& memory() const { return memory_; }
  std::uint64_t stored_primitives() const { return primitives_; }

 private:
  struct Held {
    std::vector<Piece> pieces;
    std::uint64_t bytes = 0, primitives = 0;
    std::uint64_t used = 0;                // number of the call that needed it last
    std::weak_ptr<const Gaussians4D> set;  // Timeline::Needed's, where it had one
  };
  using Segments = std::map<std::uint32_t, Held>;

  void drop(Segments::iterator segment);
  void give_back(const Held& held);
  // Whether it is held as it is needed; where it has changed it is dropped.
  bool has(const Timeline::Needed& needed);
  void begin(const Timeline& timeline);
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments);
  // Sends one that is decoded, waits for it, and keeps it.
  Status keep(std::uint32_t segment, const Gaussians4D& set,
              const std::shared_ptr<const Gaussians4D>& owner);
  Status send(const Gaussians4D& set, std::size_t first, Piece& piece);

  Device* device_ = nullptr;
  SegmentMemory memory_;
  Buffer staging_;
  std::weak_ptr<const void> timeline_;
  int sh_degree_ = 0;
  Segments held_;
  std::uint64_t bytes_ = 0, primitives_ = 0, call_ = 0;
};

}  // namespace stgs::player::vulkan
