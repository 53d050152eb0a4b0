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
// Memory of a range that is only checked, on all threads, and of a range that is passed to a
// visitor, on one thread, where it stays in the cache.
constexpr std::uint64_t kCheckedMemory = 4 << 20, kPassedMemory = 1 << 20;

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
  const SegmentEntry& segment = head.segment(ordinal);
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

// Reports the attributes that have integers out of range.
void report_out_of_range(AttributeBits attributes, std::uint32_t ordinal, std::uint64_t offset,
                         Findings& findings) {
  for (const Attribute attribute : attributes_of(kShBands)) {
    if ((attributes & attribute_bit(attribute)) == 0) continue;
    findings.error(N::kStreamValue, offset, "segment {}, {}: integer out of range", ordinal,
                   name_of(attribute));
  }
}

// Returns the attributes of tasks that are out of range.
AttributeBits out_of_range(const std::vector<StreamTask>& tasks, const MapResult& result) {
  AttributeBits out = 0;
  for (std::size_t t = 0; t < tasks.size(); ++t) {
    if (!result.in_range[t]) out |= attribute_bit(static_cast<Attribute>(tasks[t].row->attribute));
  }
  return out;
}

void map_all(const std::vector<StreamTask>& tasks, const SegmentContext& context,
             AttributeBits attributes, std::uint32_t ordinal, const IndexEntry& entry,
             Gaussians4D& set, Findings& findings) {
  const MapResult result = map_streams(tasks, context, entry.primitives, set);
  report_out_of_range(out_of_range(tasks, result), ordinal, entry.offset, findings);
  if (result.renderable) return;
  PrimitiveChecks checks;
  checks.add(set, attributes, 0, entry.primitives);
  checks.report(ordinal, entry.offset, findings);
}

constexpr AttributeBits kBandAttributes = attribute_bit(Attribute::kSh1) |
                                          attribute_bit(Attribute::kSh2) |
                                          attribute_bit(Attribute::kSh3);
constexpr Attribute kBands[] = {Attribute::kSh1, Attribute::kSh2, Attribute::kSh3};

// How RangeDecoder decodes: the memory of a range, and whether the bands of SH are decoded together
// with the attributes below sh1.
struct RangePlan {
  TimeOrigin origin = TimeOrigin::kRecord;
  std::uint64_t memory = kCheckedMemory;
  bool bands_together = false;
};

// Decodes the records of a segment range by range. The attributes below sh1 are decoded together,
// then each band of SH, of those primitives that have it.
class RangeDecoder {
 public:
  RangeDecoder(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
               const RangePlan& plan, Findings& findings)
      : plan_(plan),
        head_(head),
        ordinal_(ordinal),
        findings_(findings),
        decoders_(open_records(records, head, ordinal, findings)),
        rows_(decoders_.size()),
        good_(decoders_.size(), true) {
    if (!decoders_.empty()) context_ = context_of(records, head, ordinal, plan.origin);
    set_.sh_degree = plan.bands_together ? greatest_band() : head.metadata.sh_degree;
  }

  // Returns whether all primitives have values of each band of SH, or none has.
  bool bands_are_complete() const {
    const std::uint32_t n = head_.segment(ordinal_).base.primitives;
    return std::all_of(std::begin(kBands), std::end(kBands), [&](Attribute band) {
      return symbols_of(band) == 0 || symbols_of(band) == n;
    });
  }

  // Call it if there are no errors so far.
  void decode(const RangeVisitor& visit) {
    const IndexEntry& entry = head_.segment(ordinal_).base;
    decode_together(plan_.bands_together ? kAllAttributes : ~kBandAttributes, entry.primitives,
                    visit);
    for (const Attribute band : kBands) {
      if (plan_.bands_together) break;
      for (const RecordDecoder& decoder : decoders_)
        decode_together(attribute_bit(band), decoder.symbols_of(band), nullptr);
    }
    for (std::size_t d = 0; d < decoders_.size(); ++d) {
      const bool degrees = good_[d] && decoders_[d].degree_row() != nullptr;
      good_[d] = good_[d] && (!degrees || decoders_[d].check_degrees(greatest_, counts_));
    }
    if (!all_good()) return;
    report_out_of_range(out_of_range_, ordinal_, entry.offset, findings_);
    checks_.report(ordinal_, entry.offset, findings_);
  }

 private:
  // Returns the primitives that have values of a band, in the record with the most.
  std::uint32_t symbols_of(Attribute band) const {
    std::uint32_t out = 0;
    for (const RecordDecoder& decoder : decoders_) out = std::max(out, decoder.symbols_of(band));
    return out;
  }

  // Returns the greatest SH degree that has values.
  int greatest_band() const {
    int out = 0;
    for (const Attribute band : kBands) {
      if (symbols_of(band) > 0) out = band_of(band);
    }
    return std::min(out, head_.metadata.sh_degree);
  }

  bool all_good() const {
    return std::all_of(good_.begin(), good_.end(), [](bool good) { return good; });
  }

  // Returns the values of each range, of the attributes with this many floats per primitive.
  std::size_t range_size(AttributeBits attributes) const {
    std::uint64_t bytes = 4 * floats_per_primitive(head_.metadata.sh_degree);
    for (const RecordDecoder& decoder : decoders_) bytes += decoder.symbol_bytes(attributes);
    return std::max<std::size_t>(1, plan_.memory / (kRansBlock * bytes)) * kRansBlock;
  }

  // Decodes n values of each of these attributes.
  void decode_together(AttributeBits attributes, std::size_t n, const RangeVisitor& visit) {
    const std::size_t size = range_size(attributes);
    std::vector<Carries> carries;
    for (std::size_t begin = 0; begin < n; begin += size) {
      const DecodeRange range{attributes, begin, std::min(begin + size, n)};
      std::vector<StreamTask> tasks;
      for (std::size_t d = 0; d < decoders_.size(); ++d) {
        good_[d] = good_[d] && decoders_[d].decode_range(range, rows_[d]);
        if (!good_[d]) continue;
        decoders_[d].add_tasks(attributes, rows_[d], tasks);
        add_degrees(d, range);
      }
      if (!all_good()) continue;  // the others can have further errors
      if (begin == 0) carries = first_carries(tasks, context_);
      map(tasks, range, carries, visit);
    }
  }

  // Adds the SH degrees of a range to those found.
  void add_degrees(std::size_t d, const DecodeRange& range) {
    const StreamRow* const row = decoders_[d].degree_row();
    if (row == nullptr || (range.attributes & attribute_bit(Attribute::kShDegree)) == 0) return;
    const auto n = static_cast<std::uint32_t>(range.end - range.begin);
    const ShDegrees degrees(*row, decoders_[d].planes_of(*row, rows_[d]), n);
    greatest_ = std::max(greatest_, degrees.greatest());
    for (std::size_t k = 0; k < kShBands; ++k) counts_[k] += degrees.counts()[k];
  }

  void map(const std::vector<StreamTask>& tasks, const DecodeRange& range,
           std::vector<Carries>& carries, const RangeVisitor& visit) {
    const std::size_t n = range.end - range.begin;
    set_.time_origin = context_.time_origin;
    set_.resize(n);
    const MapResult result = map_streams(tasks, context_, n, set_, carries);
    out_of_range_ |= out_of_range(tasks, result);
    if (!result.renderable) checks_.add(set_, range.attributes, range.begin, n);
    if (visit) visit(set_, range.begin);
  }

  const RangePlan plan_;
  const FileHead& head_;
  const std::uint32_t ordinal_;
  Findings& findings_;
  std::vector<RecordDecoder> decoders_;
  std::vector<DecodedRows> rows_;
  std::vector<bool> good_;  // by decoder
  SegmentContext context_;
  Gaussians4D set_;  // of a range
  AttributeBits out_of_range_ = 0;
  PrimitiveChecks checks_;
  std::uint32_t greatest_ = 0;                  // SH degree
  std::array<std::size_t, kShBands> counts_{};  // of primitives with at least such a degree
};

}  // namespace

bool code_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                  TimeOrigin origin, CodedSegment& out, Findings& findings) {
  Findings found;
  std::vector<RecordDecoder> decoders = open_records(records, head, ordinal, found);
  const SegmentContext context = context_of(records, head, ordinal, origin);
  out.primitives = head.segment(ordinal).base.primitives;
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
  const IndexEntry& entry = head.segment(ordinal).base;
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
      map_all(tasks, context, attributes, ordinal, entry, set, found);
    }
  }
  const bool good = found.ok();
  findings.append(std::move(found));
  return good;
}

bool pass_ranges(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                 TimeOrigin origin, const RangeVisitor& visit, Findings& findings) {
  Findings found;
  const RangePlan plan{origin, kPassedMemory, true};
  RangeDecoder decoder(records, head, ordinal, plan, found);
  const bool is_possible = decoder.bands_are_complete();
  if (found.ok() && is_possible) decoder.decode(visit);
  findings.append(std::move(found));
  return is_possible;
}

bool decode_ranges(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                   const RangeVisitor& visit, DecodingWork& work, Findings& findings) {
  Findings found;
  RangeDecoder decoder(records, head, ordinal, RangePlan(), found);
  const std::uint64_t needed = decoded_values(records, head, ordinal);
  if (found.ok() && needed > work.values) {
    work.is_refused = true;
    found.unsupported(N::kMemoryLimit, head.segment(ordinal).base.offset,
                      "segment {}: neither it nor those after it are decoded, because it takes the "
                      "time of {} values, and the size of the file allows {} more; allow more than "
                      "4 GiB of memory to decode them",
                      ordinal, needed, work.values);
  } else if (found.ok()) {
    work.values -= needed;
    decoder.decode(visit);
  }
  const bool good = found.ok();
  findings.append(std::move(found));
  return good;
}

}  // namespace stgs
