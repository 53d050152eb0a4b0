// SPDX-License-Identifier: Apache-2.0
// What the stages of a frame leave for each other. Frames share it, one after the other.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "frame_layout.h"
#include "views.h"
#include "vulkan/buffer.h"

namespace stgs::player::vulkan {

// Tile instances of a frame at most; as the CPU rasteriser's limit for a view.
inline constexpr std::uint64_t kMaxInstances = std::uint64_t{1} << 26;

// What begins CountBuffer of frame.glsl.
struct Counts {
  std::uint32_t alive, visible, listed, instances;
};
inline constexpr std::uint64_t kWorkBytes = 16;  // a row of `work`
inline constexpr std::uint64_t kCountBytes =
    sizeof(Counts) + kWorks * kWorkBytes + 4 * kEnded + 4 * kPatchKinds * kMostViews;

// Passes of the sorts, 8 bits each: by depth, and by tile at most.
inline constexpr std::uint32_t kDepthPasses = 4, kMostTilePasses = 3;
static_assert(kMaxViews * (kMaxImageSide / kTilePixels) * (kMaxImageSide / kTilePixels) <=
              1u << 8 * kMostTilePasses);

inline std::uint32_t tile_passes(std::uint32_t tiles) {
  std::uint32_t passes = 1;
  while (passes < kMostTilePasses && tiles > std::uint32_t{1} << 8 * passes) ++passes;
  return passes;
}

// The rows of a frame's DigitBuffer (frame.glsl), where so many splats and instances are sorted at
// most.
struct DigitRows {
  DigitRows(std::uint64_t splats, std::uint64_t instances);
  static constexpr std::uint64_t kBytes = kDigits * sizeof(std::uint32_t);  // of a row

  std::uint32_t groups;       // which come first
  std::uint32_t depth, tile;  // super groups of a pass by depth, and then of one by tile
  std::uint32_t end(std::uint32_t tile_passes) const {
    return groups + kDepthPasses * depth + tile_passes * tile;
  }
};

// Of all views of a frame.
struct FrameNeed {
  std::uint32_t chunks = 0, tiles = 0, parts = 0;
  std::uint64_t instances = 0;
  bool fits(const FrameNeed& room) const {
    return chunks <= room.chunks && tiles <= room.tiles && parts <= room.parts &&
           instances <= room.instances;
  }
  // What is enough for both.
  FrameNeed with(const FrameNeed& other) const {
    return {std::max(chunks, other.chunks), std::max(tiles, other.tiles),
            std::max(parts, other.parts), std::max(instances, other.instances)};
  }
};

struct FrameBuffers {
  // Makes room. kUnsupported where the device's storage buffers are too small for it, kRuntime
  // where it has no memory left.
  Status ensure(const Device& device, const FrameNeed& need);
  std::uint64_t instance_capacity() const {
    return std::min({tile_keys[0].bytes(), tile_keys[1].bytes(), tile_splats[0].bytes(),
                     tile_splats[1].bytes()}) /
           sizeof(std::uint32_t);
  }
  // Chunks and instances that there can be room for.
  static std::uint64_t most_chunks(const Device& device);
  static std::uint64_t most_instances(const Device& device);

  Buffer input, counts;
  std::array<Buffer, 3> splats;              // frame.glsl's a, b, c; in the order of ids
  Buffer chunk_places, chunk_sums;           // splats of a chunk
  std::array<Buffer, 2> depth_keys, orders;  // after the sort in [0]: splats, nearest first
  Buffer tile_places;                        // instances of the splats of a workgroup
  std::array<Buffer, 2> tile_keys, tile_splats;
  Buffer tile_ranges;
  Buffer patches;  // where there are foveae: what the blend's workgroups draw
  Buffer digit_counts;
};

}  // namespace stgs::player::vulkan
