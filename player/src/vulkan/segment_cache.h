// SPDX-License-Identifier: Apache-2.0
// The segments of a timeline that are on the device, laid out to be drawn.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "device_segments.h"
#include "vulkan/buffer.h"
#include "vulkan/segment_memory.h"

namespace stgs::player::vulkan {

// Primitives of a segment, successive ones, that lie in one block.
struct Piece {
  Room room;
  std::uint32_t primitives = 0;
};

// One thread; the device outlives it.
class SegmentCache final : public DeviceSegments {
 public:
  SegmentCache() = default;
  SegmentCache(const SegmentCache&) = delete;
  SegmentCache& operator=(const SegmentCache&) = delete;
  ~SegmentCache() override { clear(); }

  // `block_bytes`: of a block, 0 for as much as is good for the device.
  void create(Device& device, std::uint64_t block_bytes);
  // Of one that the last call of hold() gave.
  const std::vector<Piece>& at(std::uint32_t segment) const { return resident_.at(segment); }
  const SegmentMemory& memory() const { return memory_; }

 private:
  Status begin(const SceneReader& reader) override;
  std::uint64_t bytes_of(std::uint64_t primitives) const override;
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) override;
  Status send(std::uint32_t segment, const Gaussians4D& set) override;
  void release(std::uint32_t segment) override;

  void give_back(const std::vector<Piece>& pieces);
  // Sends primitives from `first` on, and waits.
  Status send_piece(const Gaussians4D& set, std::size_t first, Piece& piece);

  Device* device_ = nullptr;
  SegmentMemory memory_;
  Buffer staging_;
  std::map<std::uint32_t, std::vector<Piece>> resident_;
};

}  // namespace stgs::player::vulkan
