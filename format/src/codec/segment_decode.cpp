// SPDX-License-Identifier: Apache-2.0
// Decoding a segment: from the bytes of its records to planes, and from planes to primitives (spec
// 6.5 to 8).
#include <algorithm>
#include <array>
#include <memory>
#include <optional>

#include "codec/partial_band.h"
#include "codec/record_decode.h"
#include "codec/values.h"
#include "container/segment.h"

namespace stgs {
namespace {

using N = IssueNumber;
// Memory of primitives that are only checked, on all threads, and of those that are passed to a
// visitor, on one thread, where they stay in the cache.
constexpr std::uint64_t kCheckedMemory = 4 << 20, kPassedMemory = 512 << 10;
constexpr std::size_t kWindowGroup = 256;  // windows have a multiple of these primitives

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

constexpr Attribute kBands[] = {Attribute::kSh1, Attribute::kSh2, Attribute::kSh3};

// Decodes the records of a segment to planes, range by range, and maps these window by window: the
// attributes that all primitives have, and then the bands of SH that only some have.
class RangeDecoder {
 public:
  // `memory`: bytes of a window. Ranges are windows of whole blocks. `window`: its primitives; the
  // memory of earlier ones is used again.
  RangeDecoder(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
               TimeOrigin origin, std::uint64_t memory, Gaussians4D& window, Findings& findings)
      : head_(head),
        ordinal_(ordinal),
        memory_(memory),
        findings_(findings),
        decoders_(open_records(records, head, ordinal, findings)),
        records_(decoders_.size()),
        ends_(ends_of(head, head.segment(ordinal))),
        set_(window) {
    set_.sh_degree = 0;
    if (!decoders_.empty()) context_ = context_of(records, head, ordinal, origin);
    for (std::size_t d = 0; d < decoders_.size(); ++d) find_bands(d);
  }

  // Call it if there are no errors so far.
  void decode(const RangeVisitor& visit) {
    const IndexEntry& entry = head_.segment(ordinal_).base;
    const std::size_t n = entry.primitives, window = window_size();
    const std::size_t range = std::max<std::size_t>(1, window / kRansBlock) * kRansBlock;
    for (std::size_t begin = 0; begin < n; begin += range) {
      const std::size_t end = std::min(begin + range, n);
      decode_range(begin, end);
      for (std::size_t first = begin; first < end; first += window)
        map_window(first, std::min(first + window, end), visit);
    }
    for (std::size_t d = 0; d < decoders_.size(); ++d) {
      Record& record = records_[d];
      const bool degrees = record.good && decoders_[d].degree_row() != nullptr;
      record.good =
          record.good && (!degrees || decoders_[d].check_degrees(record.greatest, record.counts));
    }
    if (!all_good()) return;
    report_out_of_range(out_of_range_, ordinal_, entry.offset, findings_);
    checks_.report(ordinal_, entry.offset, findings_);
  }

 private:
  // What was decoded of a record.
  struct Record {
    AttributeBits together = kAllAttributes;     // those that all primitives have
    std::vector<PartialBand> bands;              // the others
    DecodedRows rows;                            // of those that are together, from the window on
    ShMembers members;                           // of the window, if there are `bands`
    bool good = true;                            // no damage was found
    std::uint32_t greatest = 0;                  // SH degree
    std::array<std::size_t, kShBands> counts{};  // of primitives with at least such a degree
  };

  // Sets what the primitives of a record have, and raises the SH degree of the set to it.
  void find_bands(std::size_t d) {
    for (const Attribute band : kBands) {
      const std::uint32_t symbols = decoders_[d].symbols_of(band);
      if (symbols == 0) continue;
      set_.sh_degree = std::max(set_.sh_degree, std::min(band_of(band), head_.metadata.sh_degree));
      if (symbols == head_.segment(ordinal_).base.primitives) continue;
      records_[d].bands.emplace_back(decoders_[d], band);
      records_[d].together &= ~attribute_bit(band);
    }
  }

  bool all_good() const {
    return std::all_of(records_.begin(), records_.end(), [](const Record& r) { return r.good; });
  }

  // Returns the primitives of a window.
  std::size_t window_size() const {
    std::uint64_t bytes = 4 * floats_per_primitive(set_.sh_degree);
    for (std::size_t d = 0; d < decoders_.size(); ++d)
      bytes += decoders_[d].symbol_bytes(records_[d].together);
    const std::size_t group = memory_ / bytes < kRansBlock ? kWindowGroup : kRansBlock;
    return std::max<std::size_t>(1, memory_ / (group * bytes)) * group;
  }

  // Decodes the planes of primitives [begin, end). After damage of a record, those of the others
  // are still decoded.
  void decode_range(std::size_t begin, std::size_t end) {
    for (std::size_t d = 0; d < decoders_.size(); ++d) {
      Record& record = records_[d];
      record.good =
          record.good && decoders_[d].decode_range({record.together, begin, end}, record.rows);
    }
  }

  // Maps and checks primitives [begin, end), unless there is damage.
  void map_window(std::size_t begin, std::size_t end, const RangeVisitor& visit) {
    std::vector<StreamTask> tasks;
    for (std::size_t d = 0; d < decoders_.size(); ++d) {
      Record& record = records_[d];
      if (!record.good) continue;
      decoders_[d].add_tasks(record.together, record.rows, tasks);
      add_degrees(d, end - begin);
    }
    bool renderable = !all_good() || map_together(tasks, begin, end);
    for (Record& record : records_) {
      for (PartialBand& band : record.bands)
        record.good = record.good && decode_band(band, record.members, end - begin, renderable);
      record.rows.skip(end - begin);
    }
    if (!all_good()) return;
    if (!renderable) checks_.add(set_, kAllAttributes, begin, end - begin);
    apply_ends(ends_, begin, set_);
    if (visit) visit(set_, begin);
  }

  // Adds the SH degrees of a window of n primitives to those found.
  void add_degrees(std::size_t d, std::size_t n) {
    const StreamRow* const row = decoders_[d].degree_row();
    if (row == nullptr) return;
    Record& record = records_[d];
    const ShDegrees degrees(*row, decoders_[d].planes_of(*row, record.rows),
                            static_cast<std::uint32_t>(n));
    record.greatest = std::max(record.greatest, degrees.greatest());
    for (std::size_t k = 0; k < kShBands; ++k) record.counts[k] += degrees.counts()[k];
    if (!record.bands.empty()) record.members = degrees.members();
  }

  // Maps the attributes that all primitives of a window have. Returns whether all are renderable.
  bool map_together(const std::vector<StreamTask>& tasks, std::size_t begin, std::size_t end) {
    if (begin == 0) carries_ = first_carries(tasks, context_);
    set_.time_origin = context_.time_origin;
    set_.resize(end - begin);
    const MapResult result = map_streams(tasks, context_, end - begin, set_, carries_);
    out_of_range_ |= out_of_range(tasks, result);
    return result.renderable;
  }

  // Decodes a band of the n primitives of a window, and maps it unless there is damage.
  bool decode_band(PartialBand& band, const ShMembers& members, std::size_t n, bool& renderable) {
    const auto k = static_cast<std::size_t>(band_of(band.attribute()) - 1);
    bool in_range = true;
    const bool good =
        band.decode(members[k], context_, n, all_good() ? &set_ : nullptr, in_range, renderable);
    if (!in_range) out_of_range_ |= attribute_bit(band.attribute());
    return good;
  }

  const FileHead& head_;
  const std::uint32_t ordinal_;
  const std::uint64_t memory_;
  Findings& findings_;
  std::vector<RecordDecoder> decoders_;
  std::vector<Record> records_;  // by decoder
  const std::vector<SegmentEnd> ends_;
  SegmentContext context_;
  std::vector<Carries> carries_;  // of the attributes that are together
  Gaussians4D& set_;              // of a window
  AttributeBits out_of_range_ = 0;
  PrimitiveChecks checks_;
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
  for (const SegmentEnd& end : ends_of(head, head.segment(ordinal)))
    out.ends.push_back({end.primitive, static_cast<float>(end.ticks - out.time_origin)});
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
      if (found.ok()) apply_ends(ends_of(head, head.segment(ordinal)), 0, set);
    }
  }
  const bool good = found.ok();
  findings.append(std::move(found));
  return good;
}

bool pass_ranges(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                 TimeOrigin origin, const RangeVisitor& visit, Findings& findings) {
  Findings found;
  Gaussians4D window;
  RangeDecoder decoder(records, head, ordinal, origin, kPassedMemory, window, found);
  if (found.ok()) decoder.decode(visit);
  const bool good = found.ok();
  findings.append(std::move(found));
  return good;
}

bool decode_ranges(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                   const RangeVisitor& visit, DecodingWork& work, Findings& findings) {
  Findings found;
  RangeDecoder decoder(records, head, ordinal, TimeOrigin::kRecord, kCheckedMemory, work.window,
                       found);
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
