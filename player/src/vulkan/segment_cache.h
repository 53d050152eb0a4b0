// SPDX-License-Identifier: Apache-2.0
// The segments that are resident on the Vulkan device.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "device_segments.h"
#include "vulkan/buffer.h"
#include "vulkan/segment_memory.h"

namespace stgs::player::vulkan {

// Successive primitives of a segment in one block.
struct Upload {
  Allocation allocation;
  std::uint32_t primitives = 0;
};

// Uploads of make_resident() are staged, up to some MiB, and copied by the commands of the frame
// that needs them, so that the host does not wait. Frames in flight may use evicted memory: later
// copies follow them in the queue. One thread. The device outlives it.
class SegmentCache final : public DeviceSegments {
 public:
  SegmentCache() = default;
  SegmentCache(const SegmentCache&) = delete;
  SegmentCache& operator=(const SegmentCache&) = delete;
  ~SegmentCache() override { clear(); }

  // `block_bytes`: size of a block; 0: a default that suits the device.
  void create(Device& device, std::uint64_t block_bytes);
  // Returns the memory of a segment that the last make_resident() returned.
  const std::vector<Upload>& at(std::uint32_t segment) const { return resident_.at(segment); }
  const SegmentMemory& memory() const { return memory_; }
  // Records the staged copies. Call it at the beginning of a frame's commands, after those of all
  // earlier frames.
  void record_copies(VkCommandBuffer commands) const;
  // Returns the number of staging buffers that are filled.
  std::size_t staging_buffers() const { return filled_.size(); }
  // Moves the filled staging buffers to `to`, once the commands are submitted. They must be
  // retained until the commands have completed, and can then be recycled. Does not throw if `to`
  // has capacity for staging_buffers() more.
  void take_staging(std::vector<Buffer>& to);
  void recycle(std::vector<Buffer> buffers);

 private:
  Status begin(const SceneReader& reader) override;
  void reserve(std::uint64_t bytes) override;
  std::uint64_t bytes_of(std::uint64_t primitives) const override;
  Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) override;
  Status upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) override;
  void cancel_upload(std::uint32_t segment) override;
  void release(std::uint32_t segment) override;

  struct Copy {
    Allocation allocation;
    std::size_t buffer = 0;    // index in filled_
    std::uint64_t offset = 0;  // in that buffer
  };
  using Uploads = std::map<std::uint32_t, std::vector<Upload>>;  // by segment
  void free(Uploads& uploads, std::uint32_t segment);
  // Stages the primitives from `first` on and allocates device memory for them.
  Status stage(const Gaussians4D& set, std::size_t first, Upload& upload);
  std::uint64_t staging_bytes() const;
  // Ensures that the last of filled_ has `bytes` left.
  Status ensure_staging(std::uint64_t bytes);
  Status copy_now();

  Device* device_ = nullptr;
  std::uint64_t max_block_bytes_ = 0;
  SegmentMemory memory_;
  std::vector<Copy> copies_;        // staged
  std::uint64_t staged_bytes_ = 0;  // including copies that were cancelled
  std::vector<Buffer> filled_;      // staging buffers with the copies
  std::uint64_t filled_bytes_ = 0;  // used in the last of them
  std::vector<Buffer> spare_;       // staging buffers that are free
  Uploads resident_, incomplete_;
};

}  // namespace stgs::player::vulkan
