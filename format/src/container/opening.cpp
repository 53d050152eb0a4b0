// SPDX-License-Identifier: Apache-2.0
#include "container/opening.h"

#include "container/node.h"

namespace stgs {
namespace {

// The default limit. With the primitives that a validator decodes at a time it is 64 MiB.
constexpr std::uint64_t kBase = 56 << 20, kPerByte = 4;
// A table with its lookup; a layout or a row; a name of a private number.
constexpr std::uint64_t kTable = 18 << 10, kRow = 160, kName = 128;

}  // namespace

std::uint64_t opened_bytes(const FileHead& head) {
  return 2 * head.bytes->size() + kTable * head.layouts->tables.size() +
         kRow * head.layouts->entries + kName * head.private_names.size() + head.walk.opening_bytes;
}

std::uint64_t opening_bytes(const IndexNode& node) {
  std::uint64_t bytes = kOpeningLink * node.links.size() + kOpeningRun * node.runs.size();
  for (const IndexRun& run : node.runs) {
    bytes += kOpeningSegment * run.count + kOpeningTier * run.segments.size() +
             kOpeningFurther * run.further.size();
  }
  return bytes;
}

std::uint64_t opening_limit(const FileHead& head) {
  const std::uint64_t stated = head.limits.max_opening;
  return stated != 0 ? stated : kBase + kPerByte * head.index_bytes;
}

bool fits_opening(const FileHead& head, std::uint64_t more, std::uint64_t at, Findings& findings) {
  const std::uint64_t bytes = opened_bytes(head) + more, limit = opening_limit(head);
  if (bytes <= limit) return true;
  findings.unsupported(IssueNumber::kMemoryLimit, at,
                       "opening the file takes {} bytes or more, but its limit is {}; allow more "
                       "memory",
                       bytes, limit);
  return false;
}

}  // namespace stgs
