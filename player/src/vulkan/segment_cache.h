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

// What make_resident() sends waits, up to some MiB, to be copied by the commands of the frame that
// needs it, so that the host waits for nothing. Frames on their way may use what it drops: copies
// come after them in the queue. One thread; the device outlives it.
class SegmentCache final : public DeviceSegments {
 public:
  SegmentCache() = default;
  SegmentCache(const SegmentCache&) = delete;
  SegmentCache& operator=(const SegmentCache&) = delete;
  ~SegmentCache() override { clear(); }

  // `block_bytes`: of a block, 0 for as much as is good for the device.
  void create(Device& device, std::uint64_t block_bytes);
  // Of one that the last call of make_resident() gave.
  const std::vector<Piece>& at(std::uint32_t segment) const { return resident_.at(segment); }
  const SegmentMemory& memory() const { return memory_; }
  // The copies that wait, at the beginning of a frame's commands and after those of all before.
  void record_copies(VkCommandBuffer commands) const;
  std::size_t buffers() const { return filled_.size(); }
  // Once those commands are submitted: adds buffers() of them, which must last until they have
  // ended; then take_back() has use for them. Does not throw where `to` has room for them.
  void take_copied(std::vector<Buffer>& to);
  void take_back(std::vector<Buffer> buffers);

 private:
  Status begin(const SceneReader& reader) override;
  void reserve(std::uint64_t bytes) override;
  std::uint64_t bytes_of(std::uint64_t primitives) const override;
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) override;
  Status upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) override;
  void cancel_upload(std::uint32_t segment) override;
  void release(std::uint32_t segment) override;

  struct Copy {
    Room room;
    std::size_t buffer = 0;    // of filled_
    std::uint64_t offset = 0;  // in it
  };
  using Pieces = std::map<std::uint32_t, std::vector<Piece>>;  // of segments
  void give_back(Pieces& pieces, std::uint32_t segment);
  // Sends primitives from `first` on to a room of their own.
  Status send_room(const Gaussians4D& set, std::size_t first, Piece& piece);
  std::uint64_t host_bytes() const;
  // Room in the last of filled_; how much of it is taken then is told by filled_bytes_.
  Status fill(std::uint64_t bytes);
  Status copy_now();

  Device* device_ = nullptr;
  SegmentMemory memory_;
  std::vector<Copy> copies_;        // that wait
  std::uint64_t waiting_ = 0;       // bytes of them, and of those that were given up
  std::vector<Buffer> filled_;      // of the host, that hold them
  std::uint64_t filled_bytes_ = 0;  // of the last of these
  std::vector<Buffer> spare_;
  Pieces resident_, arriving_;
};

}  // namespace stgs::player::vulkan
