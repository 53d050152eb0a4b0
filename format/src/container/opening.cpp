// SPDX-License-Identifier: Apache-2.0
#include "container/opening.h"

#include <algorithm>

#include "container/node.h"

namespace stgs {
namespace {

// The default limit. With the primitives that a validator decodes at a time it is 64 MiB.
constexpr std::uint64_t kBase = 56 << 20, kPerByte = 4;
// The default limit for the nodes alone, so that the time for a short index is short as well. A
// segment of at least 128 primitives in 128 bytes takes 6 bytes of the index.
constexpr std::uint64_t kNodeBase = 4 << 20, kNodePerByte = 40;
// A table with its lookup; a layout or a row; a name of a private number.
constexpr std::uint64_t kTable = 18 << 10, kRow = 160, kName = 128;

// Returns the memory of the head without the nodes, bytes, at most.
std::uint64_t bytes_without_nodes(const FileHead& head) {
  return 2 * head.bytes->size() + kTable * head.layouts->tables.size() +
         kRow * head.layouts->entries + kName * head.private_names.size();
}

// Returns what the nodes read so far are charged with, bytes.
std::uint64_t charged(const FileHead& head) {
  return head.walk.opening_bytes + kOpeningPage * head.walk.pages;
}

// Returns the bytes that the nodes may take.
std::uint64_t node_limit(const FileHead& head, std::uint64_t uncounted) {
  const std::uint64_t limit = opening_limit(head, uncounted);
  const std::uint64_t left = limit - std::min(limit, bytes_without_nodes(head));
  return head.limits.max_opening != 0
             ? left
             : std::min(left, kNodeBase + kNodePerByte * (head.index_bytes + uncounted));
}

}  // namespace

std::uint64_t opening_bytes(const IndexNode& node) {
  std::uint64_t segments = 0, ends = 0;
  for (const FurtherEntry& further : node.further) ends += is_ends(further.entry) ? 1 : 0;
  for (const IndexRun& run : node.runs) segments += run.count;
  return kOpeningLink * node.links.size() + kOpeningRun * node.runs.size() +
         kOpeningSegment * segments + kOpeningTier * node.segments.size() +
         kOpeningFurther * node.further.size() + kOpeningLink * ends;
}

std::uint64_t opened_bytes(const FileHead& head) {
  return bytes_without_nodes(head) + head.walk.opening_bytes;
}

std::uint64_t opening_limit(const FileHead& head, std::uint64_t uncounted) {
  const std::uint64_t stated = head.limits.max_opening;
  return stated != 0 ? stated : kBase + kPerByte * (head.index_bytes + uncounted);
}

std::uint64_t opening_left(const FileHead& head, std::uint64_t uncounted) {
  const std::uint64_t limit = node_limit(head, uncounted);
  return limit - std::min(limit, charged(head));
}

bool fits_opening(const FileHead& head, std::uint64_t more, std::uint64_t uncounted,
                  std::uint64_t at, Findings& findings) {
  const std::uint64_t bytes = charged(head) + more, limit = node_limit(head, uncounted);
  if (bytes <= limit) return true;
  findings.unsupported(IssueNumber::kMemoryLimit, at,
                       "index: reading it takes {} bytes or more, but its limit is {}; allow more "
                       "memory",
                       bytes, limit);
  return false;
}

}  // namespace stgs
