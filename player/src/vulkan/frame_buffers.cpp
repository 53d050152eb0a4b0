// SPDX-License-Identifier: Apache-2.0
#include "vulkan/frame_buffers.h"

#include <algorithm>

namespace stgs::player::vulkan {
namespace {

constexpr std::uint64_t kSplatBytes = 16;  // per entry of a, b or c

std::uint64_t ceil_of(std::uint64_t n, std::uint64_t each) {
  return (n + each - 1) / each;
}

}  // namespace

DigitRows::DigitRows(std::uint64_t splats, std::uint64_t instances) {
  const auto groups_of = [](std::uint64_t keys) {
    return static_cast<std::uint32_t>(ceil_of(keys, kSortTile));
  };
  groups = groups_of(std::max(splats, instances));
  depth = super_group_of(groups_of(splats));
  tile = super_group_of(groups_of(instances));
}

std::uint64_t FrameBuffers::max_chunks(const Device& device) {
  return device.max_range() / (kSplatBytes * kGroup);
}

std::uint64_t FrameBuffers::max_instances(const Device& device) {
  return std::min(kMaxInstances, device.max_range() / sizeof(std::uint32_t));
}

Status FrameBuffers::ensure(const Device& device, const FrameNeed& need) {
  const std::uint64_t max_bytes = device.max_range(),
                      splat_count = std::uint64_t{kGroup} * need.chunks;
  const auto ensure_one = [&](Buffer& buffer, std::uint64_t entries, std::uint64_t each) -> Status {
    const std::uint64_t bytes = std::max<std::uint64_t>(entries, 4) * each;
    if (bytes > max_bytes) {
      return unsupported(
          "{} primitives, over all views of the frame, need a storage buffer of {} MiB, and the "
          "Vulkan device supports {} MiB; render fewer views at once, or use backend 'cpu'",
          splat_count, bytes >> 20, max_bytes >> 20);
    }
    return buffer.ensure(device, bytes, MemoryLocation::kDevice, max_bytes / 16 * 16);
  };
  STGS_TRY(ensure_one(input, 1, sizeof(FrameInput) + sizeof(Part) * std::uint64_t{need.parts + 1}));
  STGS_TRY(ensure_one(counts, 1, kCountBytes));
  for (Buffer& splat : splats) STGS_TRY(ensure_one(splat, splat_count, kSplatBytes));
  STGS_TRY(ensure_one(chunk_offsets, need.chunks, 4));
  STGS_TRY(ensure_one(chunk_sums, ceil_of(need.chunks, kScanTile), 4));
  for (Buffer& keys : depth_keys) STGS_TRY(ensure_one(keys, splat_count, 4));
  for (Buffer& order : orders) STGS_TRY(ensure_one(order, splat_count, 4));
  STGS_TRY(ensure_one(tile_offsets, kNearGroups + need.chunks, 4));
  for (Buffer& keys : tile_keys) STGS_TRY(ensure_one(keys, need.instances, 4));
  const std::uint64_t instances = std::min(tile_keys[0].bytes(), tile_keys[1].bytes()) / 4;
  for (Buffer& list : tile_splats) STGS_TRY(ensure_one(list, instances, 4));
  STGS_TRY(ensure_one(tile_ranges, need.tiles, 8));
  STGS_TRY(ensure_one(patches, need.tiles, 4));
  return ensure_one(digit_counts, DigitRows(splat_count, instances).end(kMaxTilePasses),
                    DigitRows::kBytes);
}

}  // namespace stgs::player::vulkan
