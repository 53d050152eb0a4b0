// SPDX-License-Identifier: Apache-2.0
#include "scene/validate_index.h"

#include <algorithm>
#include <tuple>

#include "container/node.h"

namespace stgs {
namespace {

using N = IssueNumber;

// Visits the nodes of an index. Damaged ones have been reported and are skipped.
class TreeChecker {
 public:
  TreeChecker(const ByteSource& source, const FileHead& head, Findings& findings)
      : source_(source), head_(head), findings_(findings), fragments_(source, head) {}

  void check(std::span<const NodeLink> links, int depth) {
    for (const NodeLink& link : links) {
      if (!seen_.insert(link.offset).second) {
        findings_.error(N::kLink, link.offset, "two links lead to the same record");
        continue;
      }
      std::optional<IndexNode> node = head_.growing() ? read_fragment(link) : read_page(link);
      if (!node) continue;
      check_times(link, *node);
      if (depth < kMaxLinkDepth) check(node->links, depth + 1);
    }
  }

  std::set<std::uint64_t> copies() { return std::move(copies_); }

 private:
  std::optional<IndexNode> read_fragment(const NodeLink& link) {
    Findings ignored;
    auto found = fragments_.at(link.offset, link.offset + kRecordHeaderBytes + link.bytes, ignored);
    if (!found.ok() || !*found) return {};
    return std::move((*found)->node);
  }

  // Returns the payload of a record of this length, or nothing if it is damaged.
  std::optional<std::vector<std::uint8_t>> payload_at(std::uint64_t at, std::uint64_t bytes) const {
    const std::uint64_t end = std::min(head_.header.file_bytes, head_.available_bytes);
    const auto record = complete_record_at(source_, at, end);
    if (!record.ok() || !*record || (*record)->length != bytes) return {};
    std::vector<std::uint8_t> payload(bytes);
    if (!source_.read(at + kRecordHeaderBytes, payload).ok()) return {};
    if (checksum(payload) != (*record)->checksum) return {};
    return payload;
  }

  std::optional<IndexNode> read_page(const NodeLink& link) {
    auto payload = payload_at(link.offset, link.bytes);
    if (link.copy != 0) {
      copies_.insert(link.copy);
      auto copy = payload_at(link.copy, link.bytes);
      if (payload && copy && *payload != *copy)
        findings_.error(N::kLink, link.copy, "copy of a node differs from it");
      if (!payload) payload = std::move(copy);
    }
    if (!payload) return {};
    ByteReader in(*payload);
    Findings ignored;
    IndexNode node;
    const NodePlace place = {link.offset, link.offset + kRecordHeaderBytes, head_.header.head_bytes,
                             head_.header.file_bytes};
    if (!parse_node(in, place, head_, node, ignored)) return {};
    return node;
  }

  // Checks that a link states the times of its node.
  void check_times(const NodeLink& link, const IndexNode& node) {
    if (node.links.empty() && node.runs.empty()) return;
    const double frames = head_.metadata.scene.frames;
    const TickRange needed = needed_of(node);
    if (link.needed.begin <= needed.begin && std::min(needed.end, frames) <= link.needed.end)
      return;
    findings_.error(N::kLink, link.offset,
                    "link states ticks {} to {}, but its node is needed at ticks {} to {}",
                    link.needed.begin, link.needed.end, needed.begin, needed.end);
  }

  const ByteSource& source_;
  const FileHead& head_;
  Findings& findings_;
  FragmentFinder fragments_;
  std::set<std::uint64_t> seen_, copies_;
};

// Checks that the segments of a part have places of their own.
void check_places(const FileHead& head, Findings& findings) {
  std::set<std::tuple<std::uint32_t, int, std::uint32_t, int>> places;  // part, level, slot, tier
  for (const SegmentEntry& segment : head.index.segments) {
    const IndexEntry& base = segment.base;
    if (places.emplace(segment.part, base.level, base.slot, base.layer).second) continue;
    findings.error(N::kSegmentOrder, base.offset, "index: two segments of part {} have one place",
                   head.parts[segment.part].number);
  }
}

}  // namespace

std::set<std::uint64_t> check_index(const ByteSource& source, const FileHead& head,
                                    Findings& findings) {
  std::set<std::uint32_t> numbers;
  for (const PartEntry& part : head.parts) {
    if (numbers.insert(part.number).second) continue;
    findings.error(N::kParts, kHeaderBytes, "index: two runs of part {} state different times",
                   part.number);
  }
  check_places(head, findings);
  if (head.lost_fragments.empty() && head.listed_primitives != head.index.primitives) {
    findings.error(N::kPrimitiveTotal, kHeaderBytes,
                   "index: primitive count mismatch (total states {}, segments have {})",
                   head.index.primitives, head.listed_primitives);
  }
  TreeChecker tree(source, head, findings);
  tree.check(head.walk.root, 1);
  return tree.copies();
}

}  // namespace stgs
