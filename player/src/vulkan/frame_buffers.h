// SPDX-License-Identifier: Apache-2.0
// The working buffers of a frame, which frames share in queue order.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "frame_layout.h"
#include "views.h"
#include "vulkan/buffer.h"

namespace stgs::player::vulkan {

// Maximum tile instances per frame; the CPU rasteriser has the same limit per view.
inline constexpr std::uint64_t kMaxInstances = std::uint64_t{1} << 26;

// The beginning of CountBuffer in frame.glsl.
struct Counts {
  std::uint32_t active, visible, listed, instances;
};
inline constexpr std::uint64_t kWorkBytes = 16;  // of a row of `work`
inline constexpr std::uint64_t kCountBytes =
    sizeof(Counts) + kWorks * kWorkBytes + 4 * kEnded + 4 * kPatchKinds * kMaxFrameViews;

// Passes of the sorts, 8 bits each: by depth, and by tile at most.
inline constexpr std::uint32_t kDepthPasses = 4, kMaxTilePasses = 3;
static_assert(kMaxViews * (kMaxImageSide / kTilePixels) * (kMaxImageSide / kTilePixels) <=
              1u << 8 * kMaxTilePasses);

// Returns the passes of the sort by tile.
inline std::uint32_t tile_passes(std::uint32_t tiles) {
  std::uint32_t passes = 1;
  while (passes < kMaxTilePasses && tiles > std::uint32_t{1} << 8 * passes) ++passes;
  return passes;
}

// The rows of a frame's DigitBuffer (frame.glsl) for sorting up to a number of splats and
// instances.
struct DigitRows {
  DigitRows(std::uint64_t splats, std::uint64_t instances);
  static constexpr std::uint64_t kBytes = kDigits * sizeof(std::uint32_t);  // per row

  std::uint32_t groups;       // rows of workgroups, which come first
  std::uint32_t depth, tile;  // rows of super groups per pass, by depth and then by tile
  std::uint32_t end(std::uint32_t tile_passes) const {
    return groups + kDepthPasses * depth + tile_passes * tile;
  }
};

// Required capacities, over all views of a frame.
struct FrameNeed {
  std::uint32_t chunks = 0, tiles = 0, parts = 0;
  std::uint64_t instances = 0;
  bool fits(const FrameNeed& capacity) const {
    return chunks <= capacity.chunks && tiles <= capacity.tiles && parts <= capacity.parts &&
           instances <= capacity.instances;
  }
  // Returns capacities that suffice for both.
  FrameNeed with(const FrameNeed& other) const {
    return {std::max(chunks, other.chunks), std::max(tiles, other.tiles),
            std::max(parts, other.parts), std::max(instances, other.instances)};
  }
};

struct FrameBuffers {
  // Grows the buffers to the capacities. kUnsupported if they exceed the storage buffer range of
  // the device, kNoMemory if it is out of memory.
  Status ensure(const Device& device, const FrameNeed& need);
  std::uint64_t instance_capacity() const {
    return std::min({tile_keys[0].bytes(), tile_keys[1].bytes(), tile_splats[0].bytes(),
                     tile_splats[1].bytes()}) /
           sizeof(std::uint32_t);
  }
  // Return the maximum capacities that the device supports.
  static std::uint64_t max_chunks(const Device& device);
  static std::uint64_t max_instances(const Device& device);

  Buffer input, counts;
  std::array<Buffer, 3> splats;              // a, b, c of frame.glsl, ordered by id
  Buffer chunk_offsets, chunk_sums;          // splats per chunk
  std::array<Buffer, 2> depth_keys, orders;  // after the sort, in [0]: splats, nearest first
  Buffer tile_offsets;                       // instances per listing workgroup
  std::array<Buffer, 2> tile_keys, tile_splats;
  Buffer tile_ranges;
  Buffer patches;  // with foveae: the work items of the blend
  Buffer digit_counts;
};

}  // namespace stgs::player::vulkan
