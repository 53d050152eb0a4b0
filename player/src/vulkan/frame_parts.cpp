// SPDX-License-Identifier: Apache-2.0
#include "vulkan/frame_parts.h"

#include "frame_layout.h"
#include "packed_segment.h"

namespace stgs::player::vulkan {

static_assert(kPackedGroup == kGroup);

FrameParts list_parts(const SegmentCache& segments, std::span<const Timeline::SegmentRef> refs) {
  FrameParts out;
  std::vector<std::vector<Part>> by_block(segments.memory().blocks());
  for (const Timeline::SegmentRef& ref : refs) {
    for (const Upload& upload : segments.at(ref.segment)) {
      Part part{};
      part.at = static_cast<std::uint32_t>(upload.allocation.offset / SegmentMemory::kAlign);
      part.primitives = upload.primitives;
      part.first_chunk = out.chunks;
      part.ticks = static_cast<float>(ref.ticks);
      part.ticks_rest = static_cast<float>(ref.ticks - static_cast<double>(part.ticks));
      by_block[upload.allocation.block].push_back(part);
      out.chunks += padded(upload.primitives) / kGroup;
    }
  }
  for (std::uint32_t b = 0; b < by_block.size(); ++b) {
    if (by_block[b].empty()) continue;
    BlockParts block{b, static_cast<std::uint32_t>(out.parts.size()),
                     static_cast<std::uint32_t>(by_block[b].size()), 0};
    for (Part& part : by_block[b]) {
      part.first_group = block.groups;
      block.groups += padded(part.primitives) / kGroup;
      out.parts.push_back(part);
    }
    out.blocks.push_back(block);
  }
  return out;
}

}  // namespace stgs::player::vulkan
