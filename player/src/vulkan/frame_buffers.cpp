// SPDX-License-Identifier: Apache-2.0
#include "vulkan/frame_buffers.h"

#include <algorithm>

namespace stgs::player::vulkan {
namespace {

constexpr std::uint64_t kSplatBytes = 16;  // of an entry of a, b or c

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

std::uint64_t FrameBuffers::most_chunks(const Device& device) {
  return device.most_range() / (kSplatBytes * kGroup);
}

std::uint64_t FrameBuffers::most_instances(const Device& device) {
  return std::min(kMaxInstances, device.most_range() / sizeof(std::uint32_t));
}

Status FrameBuffers::ensure(const Device& device, const FrameNeed& need) {
  const std::uint64_t most = device.most_range(), splat_count = std::uint64_t{kGroup} * need.chunks;
  const auto room = [&](Buffer& buffer, std::uint64_t entries, std::uint64_t each) -> Status {
    const std::uint64_t bytes = std::max<std::uint64_t>(entries, 4) * each;
    if (bytes > most) {
      return unsupported(
          "the Vulkan device's storage buffers hold {} MiB, and {} primitives at a moment, in all "
          "views together, need {} MiB; draw fewer views at once, or use backend 'cpu'",
          most >> 20, splat_count, bytes >> 20);
    }
    return buffer.ensure(device, bytes, Place::kDevice, most / 16 * 16);
  };
  STGS_TRY(room(input, 1, sizeof(FrameInput) + sizeof(Part) * std::uint64_t{need.parts + 1}));
  STGS_TRY(room(counts, 1, kCountBytes));
  for (Buffer& splat : splats) STGS_TRY(room(splat, splat_count, kSplatBytes));
  STGS_TRY(room(chunk_places, need.chunks, 4));
  STGS_TRY(room(chunk_sums, ceil_of(need.chunks, kScanTile), 4));
  for (Buffer& keys : depth_keys) STGS_TRY(room(keys, splat_count, 4));
  for (Buffer& order : orders) STGS_TRY(room(order, splat_count, 4));
  STGS_TRY(room(tile_places, kNearGroups + need.chunks, 4));
  for (Buffer& keys : tile_keys) STGS_TRY(room(keys, need.instances, 4));
  const std::uint64_t instances = std::min(tile_keys[0].bytes(), tile_keys[1].bytes()) / 4;
  for (Buffer& list : tile_splats) STGS_TRY(room(list, instances, 4));
  STGS_TRY(room(tile_ranges, need.tiles, 8));
  STGS_TRY(room(patches, need.tiles, 4));
  return room(digit_counts, DigitRows(splat_count, instances).end(kMostTilePasses),
              DigitRows::kBytes);
}

}  // namespace stgs::player::vulkan
