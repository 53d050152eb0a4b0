// SPDX-License-Identifier: Apache-2.0
// Decoding a segment: from the bytes of its records to planes, and from planes to primitives (spec
// 6.5 to 8).
#include <algorithm>
#include <array>
#include <memory>
#include <optional>

#include "codec/record_decode.h"
#include "codec/values.h"
#include "container/segment.h"

namespace stgs {
namespace {

using N = IssueNumber;

Step log_scale_step(const Layout& layout) {
  for (const StreamRow& row : layout.streams) {
    if (static_cast<Attribute>(row.attribute) == Attribute::kLogScale) return row.step;
  }
  return {};
}

// Returns the time from which those of a record count, ticks from the beginning of its part. Times
// that are stored as floats count from there.
double time_origin_of(const Layout& layout, double segment_begin) {
  for (const StreamRow& row : layout.streams) {
    if (!row.optional() && static_cast<Mapping>(row.mapping) == Mapping::kTime)
      return time_base(segment_begin, row.step);
  }
  return 0;
}

SegmentContext context_of(const SegmentRecords& records, const FileHead& head,
                          std::uint32_t ordinal, TimeOrigin origin) {
  const SegmentEntry& segment = head.index.segments[ordinal];
  const PartEntry& part = head.parts[segment.part];
  SegmentContext out;
  out.part_exponent = part_exponent_of(part.end - part.begin);
  out.begin = begin_of(segment.base.level, segment.base.slot, head.chunk_of(segment.part));
  const Layout& layout = records.base.layout_in(*head.layouts);
  if (origin == TimeOrigin::kRecord) out.time_origin = time_origin_of(layout, out.begin);
  out.first_key = records.base.first_key;
  out.shape_bounds = shape_bounds(log_scale_step(layout));
  return out;
}

// Returns the decoders of a segment's records; none if the bytes of one cannot contain its planes.
std::vector<RecordDecoder> open_records(const SegmentRecords& records, const FileHead& head,
                                        std::uint32_t ordinal, Findings& findings) {
  std::vector<RecordDecoder> out;
  bool good = true;
  for (const SegmentRecord* record : {&records.base, &records.sh}) {
    if (record->bytes.empty()) continue;
    out.emplace_back(*record, head, ordinal, findings);
    good &= out.back().open();
  }
  if (!good) out.clear();
  return out;
}

void map_all(const std::vector<StreamTask>& tasks, const SegmentContext& context,
             std::uint32_t ordinal, const IndexEntry& entry, Gaussians4D& set, Findings& findings) {
  const std::uint64_t offset = entry.offset;
  const MapResult result = map_streams(tasks, context, entry.primitives, set);
  for (std::size_t t = 0; t < tasks.size(); ++t) {
    if (result.in_range[t]) continue;
    findings.error(N::kStreamValue, offset, "segment {}, {}: integer out of range", ordinal,
                   name_of(static_cast<Attribute>(tasks[t].row->attribute)));
  }
  if (!result.renderable) check_primitives(set, ordinal, offset, findings);
}

}  // namespace

bool code_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                  TimeOrigin origin, CodedSegment& out, Findings& findings) {
  Findings found;
  std::vector<RecordDecoder> decoders = open_records(records, head, ordinal, found);
  const SegmentContext context = context_of(records, head, ordinal, origin);
  out.primitives = head.index.segments[ordinal].base.primitives;
  out.sh_degree = head.metadata.sh_degree;
  out.part_exponent = context.part_exponent;
  out.begin = context.begin;
  out.time_origin = context.time_origin;
  out.first_key = context.first_key;
  out.shape_bounds = context.shape_bounds;
  for (RecordDecoder& decoder : decoders) {
    if (!decoder.code(out.records.emplace_back())) break;
  }
  const bool good = found.ok();
  findings.append(std::move(found));
  return good;
}

bool decode_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                    AttributeBits attributes, TimeOrigin origin, Gaussians4D& set,
                    Findings& findings) {
  const IndexEntry& entry = head.index.segments[ordinal].base;
  Findings found;
  std::vector<RecordDecoder> decoders = open_records(records, head, ordinal, found);
  if (found.ok()) {
    set.sh_degree = head.metadata.sh_degree;
    resize_attributes(set, attributes, entry.primitives);
    std::vector<DecodedRows> rows(decoders.size());
    std::vector<StreamTask> tasks;
    for (std::size_t d = 0; d < decoders.size(); ++d) {
      if (decoders[d].decode(attributes, rows[d]))
        decoders[d].add_tasks(attributes, rows[d], tasks);
    }
    if (found.ok()) {
      const SegmentContext context = context_of(records, head, ordinal, origin);
      set.time_origin = context.time_origin;
      map_all(tasks, context, ordinal, entry, set, found);
    }
  }
  const bool good = found.ok();
  findings.append(std::move(found));
  return good;
}

}  // namespace stgs
