// SPDX-License-Identifier: Apache-2.0
// Reading nodes of an index: INDX, PAGE and FRAG (spec 5.1 to 5.3).
#include <algorithm>
#include <cmath>
#include <limits>

#include "container/node.h"
#include "container/opening.h"
#include "container/segment_keys.h"

namespace stgs {
namespace {

using N = IssueNumber;

constexpr std::uint64_t kMaxTotals = 1024;  // spec 5.1
// Bytes charged between checks of the limit on opening.
constexpr std::uint64_t kCheckedBytes = 64 << 10;

class NodeReader {
 public:
  NodeReader(ByteReader& in, const NodePlace& place, const FileHead& head, Findings& findings)
      : in_(in), place_(place), head_(head), findings_(findings) {}

  bool read_links(std::vector<NodeLink>& links) {
    const std::uint64_t count = in_.varint();
    for (std::uint64_t i = 0; i < count && in_.ok(); ++i) {
      const std::uint64_t at = here();
      NodeLink link;
      link.needed.begin = in_.f64();
      link.needed.end = in_.f64();
      link.offset = in_.varint();
      link.copy = in_.varint();
      link.bytes = in_.varint();
      if (!in_.ok()) break;
      if (!check_link(link, at) || !take_entry(at) || !charge(kOpeningLink, at)) return false;
      links.push_back(link);
    }
    return in_.ok() || cut_off();
  }

  bool read_runs(IndexNode& node) {
    const std::uint64_t count = in_.varint();
    node.segments.reserve(std::min(count_tiers(count), allowed_tiers()));
    for (std::uint64_t i = 0; i < count && in_.ok(); ++i) {
      if (!read_run(node)) return false;
    }
    return in_.ok() || cut_off();
  }

 private:
  std::uint64_t here() const { return place_.payload + in_.position(); }

  bool cut_off() {
    findings_.error(N::kIndexLayout, here(),
                    "index: truncated, or a number is not in its shortest form");
    return false;
  }

  bool in_body(std::uint64_t offset, std::uint64_t payload) const {
    const std::uint64_t end = place_.end;
    return offset >= place_.begin && offset <= end && end - offset >= kRecordHeaderBytes &&
           payload <= end - offset - kRecordHeaderBytes;
  }

  // Links lead forwards in a finished file and backwards in a growing one (spec 5.2, 9.3).
  bool check_link(const NodeLink& link, std::uint64_t at) {
    const bool direction = head_.growing() ? link.copy == 0 : link.offset > place_.record;
    if (direction && in_body(link.offset, link.bytes) &&
        (link.copy == 0 || in_body(link.copy, link.bytes)) && std::isfinite(link.needed.begin) &&
        std::isfinite(link.needed.end) && link.needed.begin <= link.needed.end) {
      return true;
    }
    findings_.error(
        N::kLink, at,
        "index: invalid link to {} bytes at byte {}, copy at byte {}, for ticks {} to {}",
        link.bytes, link.offset, link.copy, link.needed.begin, link.needed.end);
    return false;
  }

  // Checks that one more entry of this list or node stays within the memory limit; add_node() and
  // its caller check their sum (conformance 1.5).
  bool take_entry(std::uint64_t at) {
    const std::uint64_t limit = head_.limits.max_memory;
    ++entries_;
    if (entries_ <= kFreeEntries || entries_ - kFreeEntries <= limit / kEntryMemory) return true;
    findings_.unsupported(N::kMemoryLimit, at,
                          "index: {} entries exceed the memory limit of {} bytes", entries_, limit);
    return false;
  }

  // Charges bytes of this node to the limit on opening.
  bool charge(std::uint64_t bytes, std::uint64_t at) {
    opening_ += bytes;
    if (opening_ - checked_ < kCheckedBytes) return true;
    checked_ = opening_;
    return fits_opening(head_, opening_, place_.uncounted, at, findings_);
  }

  bool read_run(IndexNode& node) {  // spec 5.3
    const std::uint64_t at = here();
    if (!charge(kOpeningRun, at)) return false;
    const std::uint64_t number = in_.varint();
    IndexRun& run = node.runs.emplace_back();
    PartEntry& part = run.part;
    part.begin = in_.f64();
    part.end = in_.f64();
    part.displayed.begin = in_.f64();
    part.displayed.end = in_.f64();
    part.chunk_ticks = in_.f64();
    at_ = in_.varint();
    const std::uint64_t segments = in_.varint();
    if (!in_.ok()) return cut_off();
    if (!is_chunk(part.chunk_ticks)) {
      findings_.error(N::kChunk, at, "index: part {} has an invalid chunk length of {} ticks",
                      number, part.chunk_ticks);
      return false;
    }
    if (number > std::numeric_limits<std::uint32_t>::max() || segments == 0) {
      findings_.error(N::kIndexLayout, at, "index: invalid run of {} segments of part {}", segments,
                      number);
      return false;
    }
    if (!is_valid_part(part)) {
      findings_.error(
          N::kParts, at,
          "index: part {} has an invalid range (ticks {} to {}, displayed from {} to {})", number,
          part.begin, part.end, part.displayed.begin, part.displayed.end);
      return false;
    }
    part.number = static_cast<std::uint32_t>(number);
    keys_ = {};
    last_.reset();
    const std::size_t first = node.segments.size(), first_further = node.further.size();
    for (std::uint64_t s = 0; s < segments; ++s) {
      if (!read_segment(run, node)) return false;
    }
    run.segments = node.segments.size() - first;
    run.further = node.further.size() - first_further;
    return true;
  }

  // Returns the number of tiers of the next runs, as far as they are complete: at most one for two
  // bytes.
  std::uint64_t count_tiers(std::uint64_t runs) const {
    ByteReader in = in_;
    std::uint64_t tiers = 0;
    for (std::uint64_t r = 0; r < runs && in.ok(); ++r) {
      in.skip_varints(1);
      in.bytes(5 * sizeof(double));
      in.skip_varints(1);
      for (std::uint64_t segments = in.varint(); segments > 0 && in.ok(); --segments) {
        in.skip_varints(1);
        const std::uint64_t shape = in.varint(), own = shape >> 2;
        if (own > kMaxTiers) return tiers;
        in.skip_varints((shape & kSeparateSh) != 0 ? 3 * own : 2 * own);
        const std::uint64_t further = (shape & kHasFurther) != 0 ? in.varint() : 0;
        if (further > in.left()) return tiers;
        in.skip_varints(2 * further);
        tiers += in.ok() ? own : 0;
      }
    }
    return tiers;
  }

  // Returns the number of tiers within the limit on opening, and one more.
  std::uint64_t allowed_tiers() const {
    const std::uint64_t left = opening_left(head_, place_.uncounted);
    return (left - std::min(left, opening_)) / kOpeningTier + 1;
  }

  // Reads the payload length of the next record and sets its range.
  bool take_record(RecordRange& entry, std::uint64_t at) {
    const std::uint64_t payload = in_.varint();
    if (!in_.ok()) return cut_off();
    entry.offset = at_;
    if (!in_body(at_, payload)) {
      findings_.error(N::kSegmentRange, at,
                      "index: a record of {} bytes at byte {} is outside the body, which ends at "
                      "byte {}",
                      payload, at_, place_.end);
      return false;
    }
    entry.bytes = kRecordHeaderBytes + payload;
    at_ += entry.bytes;
    return fits_file(at);
  }

  // Counts a record. Those that overlap, or lie beyond the end of the file, take time for a few
  // bytes of the index; others have headers of 24 bytes.
  bool fits_file(std::uint64_t at) {
    const std::uint64_t records = head_.walk.records + ++records_;
    const std::uint64_t limit = kFreeRecords + head_.available_bytes / kBytesPerRecord;
    if (records <= limit) return true;
    findings_.unsupported(N::kMemoryLimit, at,
                          "index: more than {} records for the {} bytes of the file; if it is "
                          "incomplete, copy or download it again",
                          limit, head_.available_bytes);
    return false;
  }

  bool read_segment(IndexRun& run, IndexNode& node) {
    const std::uint64_t at = here();
    const std::uint64_t place = in_.varint(), shape = in_.varint();
    if (!in_.ok()) return cut_off();
    if (!take_entry(at) || !charge(kOpeningSegment, at)) return false;
    IndexEntry base;
    const double chunk = run.part.chunk_ticks, length = run.part.end - run.part.begin;
    if (!keys_.decode(place, base) || !(begin_of(base.level, base.slot, chunk) < length)) {
      findings_.error(N::kSegmentInterval, at, "index: a segment is outside its part {}",
                      run.part.number);
      return false;
    }
    if (last_ && !comes_before(*last_, base, chunk)) {
      findings_.error(N::kSegmentOrder, at, "index: a segment of part {} is out of order",
                      run.part.number);
      return false;
    }
    last_ = base;
    ++run.count;
    const std::uint64_t tiers = shape >> 2;
    if (tiers > kMaxTiers || (tiers == 0 && (shape & 3) != kHasFurther)) {
      findings_.error(N::kIndexLayout, at,
                      "index: a segment has {} tiers (expected at most {}) or no records", tiers,
                      kMaxTiers);
      return false;
    }
    const std::size_t first = node.segments.size();
    for (std::uint64_t t = 0; t < tiers; ++t) {
      base.layer = layer_of(Content::kPrimitives, static_cast<int>(t));
      if (!take_primitives(base, at) || !take_record(base, at) || !enough_bytes(base, at) ||
          !take_entry(at) || !charge(kOpeningTier, at)) {
        return false;
      }
      node.segments.push_back({base, {}, 0, run.count - 1});
    }
    for (std::size_t i = first; (shape & kSeparateSh) != 0 && i < node.segments.size(); ++i) {
      if (!take_record(node.segments[i].sh, at)) return false;
    }
    return (shape & kHasFurther) == 0 || take_further(base, run.count - 1, node.further, at);
  }

  // Reads the entries of further records (spec 5.7).
  // `number`: of the segment.
  bool take_further(IndexEntry entry, std::uint32_t number, std::vector<FurtherEntry>& further,
                    std::uint64_t at) {
    const std::uint64_t records = in_.varint();
    if (records == 0) {
      findings_.error(N::kIndexLayout, at, "index: a segment states 0 further records");
      return false;
    }
    std::uint64_t last = layer_of(static_cast<Content>(kMaxTierContent), kMaxTiers - 1);
    for (std::uint64_t i = 0; i < records; ++i) {
      const std::uint64_t layer = in_.varint();
      if (in_.ok() && (layer > std::numeric_limits<std::uint16_t>::max() || layer <= last)) {
        findings_.error(N::kSegmentOrder, at,
                        "index: layer {} is out of order or invalid for a further record", layer);
        return false;
      }
      entry.layer = static_cast<std::uint16_t>(layer);
      last = layer;
      entry.primitives = 0;
      if (!take_record(entry, at) || !take_entry(at) || !charge(kOpeningFurther, at)) return false;
      further.push_back({entry, 0, number});
    }
    return true;
  }

  bool take_primitives(IndexEntry& entry, std::uint64_t at) {
    const std::uint64_t primitives = in_.varint();
    if (!in_.ok()) return cut_off();
    if (primitives == 0 || primitives > std::numeric_limits<std::uint32_t>::max()) {
      findings_.error(N::kSegmentCount, at,
                      "index: a segment has {} primitives (expected 1 to 2^32 - 1)", primitives);
      return false;
    }
    entry.primitives = static_cast<std::uint32_t>(primitives);
    return true;
  }

  bool enough_bytes(const IndexEntry& entry, std::uint64_t at) {  // spec 5.5
    const std::uint64_t payload = entry.bytes - kRecordHeaderBytes;
    const std::uint64_t primitives = entry.primitives;
    if (primitives <= kMaxPrimitivesPerByte * payload) return true;
    findings_.error(N::kSegmentCount, at, "index: {} primitives are too many for {} bytes",
                    primitives, payload);
    return false;
  }

  ByteReader& in_;
  const NodePlace place_;
  const FileHead& head_;
  Findings& findings_;
  std::uint64_t entries_ = 0, records_ = 0;
  std::uint64_t opening_ = 0, checked_ = 0;  // bytes charged; those when they were last checked
  std::uint64_t at_ = 0;                     // offset of the next record of the run
  SegmentKeyCoder keys_;
  std::optional<IndexEntry> last_;  // place of the previous segment of the run
};

// Reads the totals of attributes.
bool parse_totals(ByteReader& in, std::vector<AttributeBytes>& rows) {
  const std::uint64_t count = in.varint();
  if (!in.ok() || count > kMaxTotals) return false;
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint64_t attribute = in.varint(), bytes = in.varint();
    if (!in.ok() || attribute > std::numeric_limits<std::uint16_t>::max()) return false;
    rows.push_back({static_cast<std::uint16_t>(attribute), bytes});
  }
  return true;
}

}  // namespace

bool parse_links(ByteReader& in, const NodePlace& place, const FileHead& head,
                 std::vector<NodeLink>& links, Findings& findings) {
  return NodeReader(in, place, head, findings).read_links(links);
}

bool parse_node(ByteReader& in, const NodePlace& place, const FileHead& head, IndexNode& node,
                Findings& findings) {
  NodeReader reader(in, place, head, findings);
  return reader.read_links(node.links) && reader.read_runs(node);
}

bool parse_index(std::span<const std::uint8_t> payload, std::uint64_t offset, FileHead& head,
                 Findings& findings) {
  ByteReader in(payload);
  head.index.primitives = in.varint();
  if (!in.ok() || !parse_totals(in, head.index.attributes)) {
    findings.error(N::kIndexLayout, offset, "index: truncated, or more than {} totals", kMaxTotals);
    return false;
  }
  if (head.index.primitives > head.limits.max_primitives) {
    findings.unsupported(N::kPrimitiveLimit, offset, "index: {} primitives exceed the limit of {}",
                         head.index.primitives, head.limits.max_primitives);
    return false;
  }
  const NodePlace place = {offset - kRecordHeaderBytes, offset, head.header.head_bytes,
                           head.header.file_bytes};
  IndexNode root;
  return parse_node(in, place, head, root, findings) &&
         add_node(std::move(root), 0, 0, head.walk.pending.end(), head, findings);
}

}  // namespace stgs
