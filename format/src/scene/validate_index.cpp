// SPDX-License-Identifier: Apache-2.0
#include "scene/validate_index.h"

#include <algorithm>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <utility>

namespace stgs {
namespace {

using N = IssueNumber;

// Checks that no record is linked to twice (spec 5.2, 9.3).
void check_repeated(const FileHead& head, Findings& findings) {
  std::vector<std::uint64_t> links;  // the offsets of their records
  for (const auto& [record, node] : head.walk.nodes) {
    for (const NodeLink& link : node.links) links.push_back(link.offset);
  }
  for (const NodeLink& link : head.walk.earlier) links.push_back(link.offset);
  if (!std::is_sorted(links.begin(), links.end())) std::sort(links.begin(), links.end());
  for (auto first = links.begin(); first != links.end();) {
    const auto end = std::find_if(first, links.end(), [=](std::uint64_t o) { return o != *first; });
    if (end - first > 1) {
      findings.error(head.growing() ? N::kFragment : N::kLink, *first,
                     "index: {} links lead to one record (expected 1)", end - first);
    }
    first = end;
  }
}

// Checks that links state the times of all that they lead to (spec 5.2).
class LinkTimes {
 public:
  LinkTimes(const FileHead& head, Findings& findings) : nodes_(head.walk.nodes) {
    for (const auto& [record, node] : nodes_) check(node.links, findings);
    check(head.walk.earlier, findings);
  }

 private:
  void check(const std::vector<NodeLink>& links, Findings& findings) {
    for (const NodeLink& link : links) {
      if (nodes_.count(link.offset) == 0) continue;  // not read
      const TickRange needed = needed_below(link.offset);
      if (needed.begin > needed.end ||
          (link.needed.begin <= needed.begin && needed.end <= link.needed.end)) {
        continue;
      }
      findings.error(N::kLink, link.offset,
                     "index: a link states ticks {} to {} for a node of ticks {} to {}",
                     link.needed.begin, link.needed.end, needed.begin, needed.end);
    }
  }

  // Returns the times at which segments of a node and below it are needed. Links lead in one
  // direction, and nodes that were read are at most kMaxLinkDepth links deep.
  const TickRange& needed_below(std::uint64_t record) {
    const auto [known, is_new] = needed_.try_emplace(record);
    if (!is_new) return known->second;
    TickRange all = nodes_.at(record).needed;
    for (const NodeLink& link : nodes_.at(record).links) {
      if (nodes_.count(link.offset) == 0) continue;
      const TickRange below = needed_below(link.offset);
      if (below.begin > below.end) continue;
      all = {std::min(all.begin, below.begin), std::max(all.end, below.end)};
    }
    return needed_[record] = all;
  }

  const std::map<std::uint64_t, IndexWalk::Node>& nodes_;
  std::map<std::uint64_t, TickRange> needed_;  // by record
};

// Returns the payload of the PAGE record at `at`, or nothing if it is damaged.
std::optional<std::vector<std::uint8_t>> page_at(const ByteSource& source, const FileHead& head,
                                                 std::uint64_t at, std::uint64_t bytes) {
  const auto record =
      complete_record_at(source, at, std::min(head.header.file_bytes, head.available_bytes));
  if (!record.ok() || !*record || (*record)->length != bytes) return {};
  std::vector<std::uint8_t> payload(bytes);
  if (!source.read(at + kRecordHeaderBytes, payload).ok()) return {};
  if (checksum(payload) != (*record)->checksum) return {};
  return payload;
}

// A record of a node, as a link states it.
struct NodePlace {
  std::uint64_t offset = 0, bytes = 0;  // bytes: of its payload
  auto operator<=>(const NodePlace&) const = default;
};

// Returns the copies that do not overlap, by the node that they belong to, so that no byte of the
// file is read twice.
std::map<NodePlace, std::vector<std::uint64_t>> separate_copies(
    const std::map<std::uint64_t, NodePlace>& nodes, Findings& findings) {
  std::map<NodePlace, std::vector<std::uint64_t>> copies;
  std::uint64_t end = 0;
  bool reported = false;
  for (const auto& [copy, node] : nodes) {
    if (copy >= end) {
      copies[node].push_back(copy);
      end = copy + kRecordHeaderBytes + node.bytes;
    } else if (!std::exchange(reported, true)) {
      findings.error(N::kLink, copy, "copies of nodes overlap");
    }
  }
  return copies;
}

// Checks that intact copies of nodes are identical to them (spec 5.2). Returns their offsets.
std::set<std::uint64_t> check_copies(const ByteSource& source, const FileHead& head,
                                     Findings& findings) {
  std::set<std::uint64_t> offsets;
  std::map<std::uint64_t, NodePlace> nodes;  // that were read, by the offset of the copy
  for (const auto& [record, node] : head.walk.nodes) {
    for (const NodeLink& link : node.links) {
      if (link.copy == 0 || !offsets.insert(link.copy).second) continue;
      if (head.walk.nodes.count(link.offset) == 0) continue;
      nodes[link.copy] = {link.offset, link.bytes};
    }
  }
  for (const auto& [node, copies] : separate_copies(nodes, findings)) {
    const auto page = page_at(source, head, node.offset, node.bytes);
    for (const std::uint64_t at : copies) {
      const auto copy = page ? page_at(source, head, at, node.bytes) : std::nullopt;
      if (copy && *page != *copy) findings.error(N::kLink, at, "copy of a node differs from it");
    }
  }
  return offsets;
}

// A record of a segment, with its place: part, level and slot.
struct PlacedRecord {
  std::uint32_t part = 0;  // its number in the file
  std::int16_t level = 0;
  std::uint32_t slot = 0;
  std::uint32_t number = 0;  // of the segment
  std::uint32_t order = 0;   // in the index
  std::uint64_t offset = 0;

  // A number of the level and slot, below that of the part.
  auto place() const { return std::pair(part, std::uint64_t(level + 1) << 32 | slot); }
  bool is_of_segment(const PlacedRecord& other) const {
    return number == other.number && place() == other.place();
  }
};

// Checks that no two segments have one place, and no two parts one number (spec 5.3).
void check_places(const FileHead& head, Findings& findings) {
  std::set<std::uint32_t> numbers;
  for (const PartEntry& part : head.parts) {
    if (numbers.insert(part.number).second) continue;
    findings.error(N::kParts, kHeaderBytes, "index: two runs of part {} state different times",
                   part.number);
  }
  std::vector<PlacedRecord> records;
  const auto add = [&](const IndexEntry& entry, std::uint32_t part, std::uint32_t number) {
    const PlacedRecord record = {head.parts[part].number,
                                 entry.level,
                                 entry.slot,
                                 number,
                                 static_cast<std::uint32_t>(records.size()),
                                 entry.offset};
    // Of the records of a segment, which follow each other, the first one is enough.
    if (records.empty() || !records.back().is_of_segment(record)) records.push_back(record);
  };
  for (const SegmentEntry& tier : head.index.segments) add(tier.base, tier.part, tier.number);
  for (const FurtherEntry& further : head.index.further)
    add(further.entry, further.part, further.number);
  const auto at_place = [](const PlacedRecord& a, const PlacedRecord& b) {
    return a.place() < b.place();
  };
  if (!std::is_sorted(records.begin(), records.end(), at_place))
    std::sort(records.begin(), records.end(), [](const PlacedRecord& a, const PlacedRecord& b) {
      return std::tuple(a.place(), a.order) < std::tuple(b.place(), b.order);
    });
  std::vector<PlacedRecord> repeated;
  for (std::size_t i = 1; i < records.size(); ++i) {
    if (records[i].place() == records[i - 1].place() && records[i].number != records[i - 1].number)
      repeated.push_back(records[i]);
  }
  std::sort(repeated.begin(), repeated.end(),
            [](const PlacedRecord& a, const PlacedRecord& b) { return a.order < b.order; });
  for (const PlacedRecord& record : repeated) {
    findings.error(N::kPlace, record.offset, "index: two segments of part {} have one place",
                   record.part);
  }
}

}  // namespace

std::set<std::uint64_t> check_index(const ByteSource& source, const FileHead& head,
                                    Findings& findings) {
  check_places(head, findings);
  check_repeated(head, findings);
  LinkTimes(head, findings);
  if (head.lost_fragments.empty() && head.listed_primitives != head.index.primitives) {
    findings.error(N::kPrimitiveTotal, kHeaderBytes,
                   "index: primitive count mismatch (total states {}, segments have {})",
                   head.index.primitives, head.listed_primitives);
  }
  return check_copies(source, head, findings);
}

}  // namespace stgs
