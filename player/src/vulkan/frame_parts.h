// SPDX-License-Identifier: Apache-2.0
// The parts of the resident segments that a frame renders.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "stgs/player/timeline.h"
#include "vulkan/frame_commands.h"
#include "vulkan/segment_cache.h"

namespace stgs::player::vulkan {

struct FrameParts {
  std::vector<Part> parts;         // grouped by block
  std::vector<BlockParts> blocks;  // that have parts
  std::uint32_t chunks = 0;        // of all parts
};

// Lists the uploads of resident segments. Chunks are numbered by id, and parts are grouped by
// block.
FrameParts list_parts(const SegmentCache& segments, std::span<const Timeline::SegmentRef> refs);

}  // namespace stgs::player::vulkan
