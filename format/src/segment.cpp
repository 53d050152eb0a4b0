// SPDX-License-Identifier: Apache-2.0
#include "segment.h"

#include <algorithm>
#include <optional>

#include "bytes.h"
#include "draco_points.h"
#include "stgs/format/parallel.h"
#include "values.h"
#include "zstd_frame.h"

namespace stgs {
namespace {

using N = IssueNumber;

bool is_known(const StreamRow& row) {
  return row.attribute < kOptionalAttributes;  // spec 6.4
}
bool is_coded(const StreamRow& row) {
  return static_cast<Coder>(row.coder) == Coder::kRans;
}

bool same_segment(ByteReader& in, const IndexEntry& expected) {
  const auto level = static_cast<std::int16_t>(in.u16());
  const std::uint16_t layer = in.u16();
  const std::uint32_t slot = in.u32(), primitives = in.u32();
  return level == expected.level && layer == expected.layer && slot == expected.slot &&
         primitives == expected.primitives;
}

// That the layout has the streams of the record's content, in their order.
bool check_attributes(const Layout& layout, const IndexEntry& entry, int sh_degree,
                      std::uint32_t ordinal, std::uint64_t offset, Findings& findings) {
  const std::span<const Attribute> all = attributes_of(sh_degree);
  const std::size_t base = attributes_of(0).size();
  const bool harmonics = content_of(entry.layer) == static_cast<int>(Content::kHarmonics);
  const std::span<const Attribute> needed = harmonics ? all.subspan(base) : all;
  std::size_t found = 0;
  for (const StreamRow& row : layout.streams) {
    if (!is_known(row)) continue;
    if (found == needed.size() || row.attribute != static_cast<std::uint16_t>(needed[found])) {
      findings.error(N::kStreamMissing, offset, "segment {}: its layout has attribute {}, not {}",
                     ordinal, row.attribute,
                     found == needed.size() ? "no more" : name_of(needed[found]));
      return false;
    }
    ++found;
  }
  // The harmonics above degree 0 may be left to a record of their own.
  if (found == needed.size() || (!harmonics && found == base)) return true;
  findings.error(N::kStreamMissing, offset, "segment {}: no stream for {}", ordinal,
                 name_of(needed[found]));
  return false;
}

// Whether the layout leaves the harmonics above degree 0 out.
bool is_partial(const Layout& layout, int sh_degree) {
  const auto known = std::count_if(layout.streams.begin(), layout.streams.end(), is_known);
  return static_cast<std::size_t>(known) < attributes_of(sh_degree).size();
}

// That a layout is one of the file's profile (spec 8.1), as far as this version knows it.
bool check_profile_of(const Layout& layout, Profile profile, std::uint32_t ordinal,
                      std::uint64_t offset, Findings& findings) {
  for (const StreamRow& row : layout.streams) {
    if (!is_known(row)) continue;
    const bool draco = static_cast<Coder>(row.coder) == Coder::kDraco;
    const bool mapped = static_cast<Mapping>(row.mapping) != Mapping::kFloat;
    const bool fits = profile == Profile::kLossless    ? !mapped && !draco
                      : profile == Profile::kQuantised ? !draco
                                                       : true;
    if (fits) continue;
    findings.error(N::kProfile, offset, "segment {}, {}: mapping {} with coder {} in a {} file",
                   ordinal, name_of(static_cast<Attribute>(row.attribute)), row.mapping, row.coder,
                   profile_name(profile));
    return false;
  }
  return true;
}

// Planes that are decoded: those that no table knows without any bytes.
std::size_t varying_planes(const Layout& layout, const LayoutSet& set) {
  std::size_t count = 0;
  for (const StreamRow& row : layout.streams) {
    if (!is_known(row)) continue;
    if (!is_coded(row)) count += row.planes();
    for (const std::uint16_t table : row.tables) count += set.only[table] < 0 ? 1 : 0;
  }
  return count;
}

// Adds to the memory of a segment (conformance 1.5); false where that passes the limit.
bool take_memory(std::uint64_t bytes, const FileHead& head, std::uint32_t ordinal,
                 std::uint64_t offset, std::uint64_t& memory, Findings& findings) {
  const std::uint64_t limit = head.limits.max_memory;
  if (memory <= limit && bytes <= limit - memory) {
    memory += bytes;
    return true;
  }
  findings.unsupported(N::kMemoryLimit, offset,
                       "segment {}: decoding takes more memory than the limit of {} bytes", ordinal,
                       limit);
  return false;
}

// Finds the record's layout and the bytes of its streams (spec 6.1). `memory`: see SegmentRecords.
bool parse_segment(std::span<const std::uint8_t> payload, const FileHead& head,
                   std::uint32_t ordinal, const IndexEntry& expected, SegmentRecord& record,
                   std::uint64_t& memory, Findings& findings) {
  ByteReader in(payload);
  if (!same_segment(in, expected)) {
    findings.error(N::kSegmentMismatch, record.payload_at,
                   "segment {}: is not the one that the index lists", ordinal);
    return false;
  }
  record.layout = in.u16();
  record.checksum = in.u64();
  record.has_own = record.layout == kOwnLayout;
  if (record.has_own) {
    if (!parse_layouts(in, record.payload_at, head.limits.max_memory - memory, record.own,
                       findings)) {
      return false;
    }
    memory += record.own.tables.size() * kTableMemory;
    record.layout = 0;
  }
  const std::vector<Layout>& layouts = record.set(head.layouts).layouts;
  if (record.layout >= layouts.size() || (record.has_own && layouts.size() != 1)) {
    findings.error(N::kLayouts, record.payload_at, "segment {}: layout {} of {}", ordinal,
                   record.layout, layouts.size());
    return false;
  }
  const Layout& layout = layouts[record.layout];
  if (!check_attributes(layout, expected, head.metadata.sh_degree, ordinal, record.payload_at,
                        findings) ||
      !check_profile_of(layout, head.metadata.profile, ordinal, record.payload_at, findings) ||
      !take_memory(
          varying_planes(layout, record.set(head.layouts)) * std::uint64_t{expected.primitives},
          head, ordinal, record.payload_at, memory, findings)) {
    return false;
  }
  if (layout.has_first_key()) record.first_key = in.u64();
  std::vector<std::uint64_t> sizes(layout.streams.size());
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    if (!is_coded(layout.streams[i])) sizes[i] = in.u64();
  }
  for (const std::uint64_t size : sizes) record.streams.push_back(in.bytes(size));
  if (layout.has_group()) record.group = in.bytes(in.left());
  if (in.ok() && in.left() == 0) return true;
  findings.error(N::kStreamTable, record.payload_at,
                 "segment {}: {} bytes do not hold the streams of its layout, or hold more",
                 ordinal, payload.size());
  return false;
}

// Reads one record and checks it against its index row.
bool read_record(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                 const IndexEntry& entry, SegmentRecord& record, std::uint64_t& memory,
                 Findings& findings) {
  if (!head.has(entry)) {
    findings.error(N::kFileSize, entry.offset,
                   "segment {}: its {} bytes are not all there, the file is truncated", ordinal,
                   entry.bytes);
    return false;
  }
  if (!take_memory(entry.bytes, head, ordinal, entry.offset, memory, findings)) return false;
  record.bytes.resize(entry.bytes);
  if (Status status = source.read(entry.offset, record.bytes); !status.ok()) {
    findings.failed_read(entry.offset, status);
    return false;
  }
  RecordHeader header;
  if (!parse_record_header(record.bytes, entry.offset, entry.offset + entry.bytes, header,
                           findings)) {
    return false;
  }
  if (header.tag != kSegmentTag || header.length != entry.bytes - kRecordHeaderBytes) {
    findings.error(N::kSegmentMismatch, entry.offset,
                   "segment {}: record '{}' of {} bytes is not the one that the index lists",
                   ordinal, tag_text(header.tag), header.length);
    return false;
  }
  if ((header.flags & kCritical) == 0) {  // what the index lists cannot be skipped
    findings.error(N::kNotCritical, entry.offset, "segment {} is not marked critical", ordinal);
    return false;
  }
  if (!check_flags(header, true, entry.offset, findings)) return false;
  const auto payload = std::span<const std::uint8_t>(record.bytes).subspan(kRecordHeaderBytes);
  record.payload_at = entry.offset + kRecordHeaderBytes;
  if (checksum(payload) != header.checksum) {
    findings.error(N::kRecordChecksum, record.payload_at,
                   "segment {} is damaged (checksum of {} bytes)", ordinal, payload.size());
  }
  return parse_segment(payload, head, ordinal, entry, record, memory, findings);
}

// Why the stored bytes of a stream that is not rANS cannot be its planes (spec 7.2), or null;
// allocates nothing. `n`: primitives.
const char* stored_problem(std::span<const std::uint8_t> stored, const StreamRow& row,
                           std::size_t n) {
  if (static_cast<Coder>(row.coder) == Coder::kDraco) {
    return draco_fits(stored, n) ? nullptr : "its point cloud is not that of its primitives";
  }
  const std::uint64_t size = std::uint64_t{n} * row.planes();
  return stored.size() == size ? nullptr : zstd_frame_problem(stored, size);
}

// What is wrong with `stored`, which must be the planes or one frame of them (spec 7.2), or null.
const char* unpack(std::span<const std::uint8_t> stored, std::span<std::uint8_t> planes) {
  if (stored.size() == planes.size()) {
    std::copy(stored.begin(), stored.end(), planes.begin());
    return nullptr;
  }
  return zstd_unpack(stored, planes);
}

// The planes of a record, decoded.
struct DecodedPlanes {
  std::vector<std::uint8_t> symbols;       // of the planes that are no constants, in their order
  std::vector<std::vector<Plane>> planes;  // by row; none for a row that is skipped
};

// Decodes the streams of a record of n primitives.
class RecordDecoder {
 public:
  RecordDecoder(const SegmentRecord& record, const LayoutSet& of_file, std::uint32_t ordinal,
                std::size_t n, Findings& findings)
      : record_(record),
        set_(record.set(of_file)),
        layout_(record.layout_in(of_file)),
        ordinal_(ordinal),
        n_(n),
        findings_(findings) {}

  // That the bytes can hold the planes: all streams of a segment must pass before any memory of its
  // size is taken.
  bool check_sizes() {
    bool good = true;
    for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
      const StreamRow& row = layout_.streams[i];
      if (!is_known(row) || is_coded(row)) continue;
      if (static_cast<Coder>(row.coder) == Coder::kDraco && !check_draco().ok()) {
        findings_.not_built(N::kStreamUnsupported, record_.payload_at, check_draco());
        return false;
      }
      const char* const problem = stored_problem(record_.streams[i], row, n_);
      if (problem == nullptr) continue;
      corrupt(name_of(static_cast<Attribute>(row.attribute)), problem);
      good = false;
    }
    if (!layout_.has_group()) return good;
    auto group = RansGroupDecoder::open(record_.group, n_);
    if (group.ok()) {
      group_.emplace(std::move(*group));
      return good;
    }
    corrupt("rANS", group.status().message().c_str());
    return false;
  }

  bool decode(DecodedPlanes& out) {
    out.symbols.resize(n_ * varying_planes(layout_, set_));
    const std::vector<std::span<std::uint8_t>> places = place_planes(out);
    if (!decode_bytes(places)) return false;
    for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
      const StreamRow& row = layout_.streams[i];
      if (is_known(row) && is_coded(row)) decode_coded(row, places[i].data());
    }
    if (group_ && !group_->finish()) {
      corrupt("rANS", "a block does not end as it must");
      return false;
    }
    if (checksum(out.symbols) == record_.checksum) return true;
    findings_.error(N::kStreamChecksum, record_.payload_at, "segment {}: decoded planes are wrong",
                    ordinal_);
    return false;
  }

  // Adds what is to be mapped; `decoded` must outlive it.
  void add_tasks(const DecodedPlanes& decoded, std::vector<StreamTask>& tasks) const {
    for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
      if (is_known(layout_.streams[i]))
        tasks.push_back({&layout_.streams[i], decoded.planes[i].data()});
    }
  }

  // The record as a decoder elsewhere takes it, after check_sizes().
  bool code(CodedRecord& out) const {
    std::vector<std::span<std::uint8_t>> places(layout_.streams.size());
    std::size_t stored = 0;
    for (const StreamRow& row : layout_.streams) {
      if (is_known(row) && !is_coded(row)) stored += row.planes();
    }
    out.stored.resize(n_ * stored);
    std::uint32_t in_group = 0, in_stored = 0;
    for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
      const StreamRow& row = layout_.streams[i];
      if (!is_known(row)) continue;
      if (!is_coded(row)) {
        places[i] = std::span(out.stored).subspan(n_ * in_stored, n_ * row.planes());
      }
      out.streams.push_back(coded_stream(row, in_group, in_stored, out.tables));
    }
    out.bytes.assign(record_.group.begin(), record_.group.end());
    if (layout_.has_group()) {
      Result<std::vector<RansBlockPlace>> blocks = rans_layout(record_.group, n_);
      if (!blocks.ok()) return corrupt("rANS", blocks.status().message().c_str()), false;
      out.blocks = std::move(*blocks);
    }
    out.own_tables = record_.has_own;
    if (record_.has_own) out.lookups = set_.lookups;
    return decode_bytes(places);
  }

 private:
  // Counts the planes that it takes of the group and of those stored.
  CodedStream coded_stream(const StreamRow& row, std::uint32_t& in_group, std::uint32_t& in_stored,
                           std::vector<std::uint16_t>& tables) const {
    CodedStream out;
    out.attribute = static_cast<Attribute>(row.attribute);
    out.mapping = static_cast<Mapping>(row.mapping);
    out.prediction = static_cast<Prediction>(row.prediction);
    out.exponent = row.exponent;
    out.components = row.components;
    out.digits = row.digits;
    out.digit_bits = row.digit_bits;
    std::copy_n(row.origin, 3, out.origin.begin());
    for (std::size_t p = 0; p < row.planes(); ++p) {
      const std::int16_t only = is_coded(row) ? set_.only[row.tables[p]] : std::int16_t{-1};
      if (!is_coded(row)) {
        out.planes.push_back({CodedPlane::Source::kStored, 0, in_stored++});
      } else if (only >= 0) {
        out.planes.push_back({CodedPlane::Source::kConstant, static_cast<std::uint8_t>(only), 0});
      } else {
        out.planes.push_back({CodedPlane::Source::kGroup, 0, in_group++});
        tables.push_back(row.tables[p]);
      }
    }
    return out;
  }

  // Where the planes of each row are to be decoded.
  std::vector<std::span<std::uint8_t>> place_planes(DecodedPlanes& out) const {
    std::vector<std::span<std::uint8_t>> places;
    std::uint8_t* at = out.symbols.data();
    for (const StreamRow& row : layout_.streams) {
      std::uint8_t* const begin = at;
      std::vector<Plane>& planes = out.planes.emplace_back();
      for (std::size_t p = 0; is_known(row) && p < row.planes(); ++p) {
        const std::int16_t only = is_coded(row) ? set_.only[row.tables[p]] : std::int16_t{-1};
        planes.push_back(only < 0 ? Plane{at, 0} : Plane{nullptr, static_cast<std::uint8_t>(only)});
        at += only < 0 ? n_ : 0;
      }
      places.emplace_back(begin, at);
    }
    return places;
  }

  void decode_coded(const StreamRow& row, std::uint8_t* at) {
    for (const std::uint16_t table : row.tables) {
      if (set_.only[table] >= 0) continue;
      group_->next_plane(set_.lookups[table], at);
      at += n_;
    }
  }

  // The streams that are not rANS.
  bool decode_bytes(const std::vector<std::span<std::uint8_t>>& places) const {
    if (std::all_of(layout_.streams.begin(), layout_.streams.end(), is_coded)) return true;
    std::vector<const char*> problems(places.size());
    parallel_for(std::size_t{0}, places.size(), [&](std::size_t i) {
      const StreamRow& row = layout_.streams[i];
      if (!is_known(row) || is_coded(row)) return;
      problems[i] = static_cast<Coder>(row.coder) == Coder::kDraco
                        ? draco_decode(record_.streams[i], n_, places[i])
                        : unpack(record_.streams[i], places[i]);
    });
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (problems[i] == nullptr) continue;
      corrupt(name_of(static_cast<Attribute>(layout_.streams[i].attribute)), problems[i]);
      return false;
    }
    return true;
  }

  void corrupt(const char* what, const char* problem) const {
    findings_.error(N::kStreamCorrupt, record_.payload_at, "segment {}, {}: {}", ordinal_, what,
                    problem);
  }

  const SegmentRecord& record_;
  const LayoutSet& set_;
  const Layout& layout_;
  std::uint32_t ordinal_;
  std::size_t n_;
  Findings& findings_;
  std::optional<RansGroupDecoder> group_;
};

SegmentContext context_of(const SegmentRecords& records, const FileHead& head,
                          std::uint32_t ordinal) {
  const SegmentEntry& segment = head.index.segments[ordinal];
  const PartEntry& part = head.parts[segment.part];
  SegmentContext out;
  out.part_ticks = static_cast<float>(part.end - part.begin);
  out.begin = begin_in_part(segment.base, head.index.chunk_ticks, part);
  out.first_key = records.base.first_key;
  return out;
}

void map_all(const std::vector<StreamTask>& tasks, const SegmentContext& context,
             std::uint32_t ordinal, std::uint64_t offset, Gaussians4D& set, Findings& findings) {
  const MapResult result = map_streams(tasks, context, set);
  for (std::size_t t = 0; t < tasks.size(); ++t) {
    if (result.in_range[t]) continue;
    findings.error(N::kStreamValue, offset, "segment {}, {}: an integer is out of range", ordinal,
                   name_of(static_cast<Attribute>(tasks[t].row->attribute)));
  }
  if (!result.drawable) check_primitives(set, ordinal, offset, findings);
}

}  // namespace

bool read_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                  bool with_harmonics, SegmentRecords& records, Findings& findings) {
  const SegmentEntry& segment = head.index.segments[ordinal];
  records.memory = 0;
  if (!take_memory(4 * floats_per_primitive(head.metadata.sh_degree) * segment.base.primitives,
                   head, ordinal, segment.base.offset, records.memory, findings) ||
      !read_record(source, head, ordinal, segment.base, records.base, records.memory, findings)) {
    return false;
  }
  const bool partial = is_partial(records.base.layout_in(head.layouts), head.metadata.sh_degree);
  const bool own = segment.harmonics.bytes > 0;
  if (partial != own) {
    findings.error(N::kStreamMissing, segment.base.offset,
                   "segment {}: the harmonics above degree 0 are stored {}", ordinal,
                   own ? "twice" : "nowhere");
    return false;
  }
  if (!own || !with_harmonics) return true;
  return read_record(source, head, ordinal, segment.harmonics, records.harmonics, records.memory,
                     findings);
}

bool code_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                  CodedSegment& out, Findings& findings) {
  Findings found;
  std::vector<RecordDecoder> decoders;
  bool sizes_good = true;
  for (const SegmentRecord* record : {&records.base, &records.harmonics}) {
    if (record->bytes.empty()) continue;
    decoders.emplace_back(*record, head.layouts, ordinal,
                          head.index.segments[ordinal].base.primitives, found);
    sizes_good &= decoders.back().check_sizes();
  }
  if (sizes_good) {
    const SegmentContext context = context_of(records, head, ordinal);
    out.primitives = head.index.segments[ordinal].base.primitives;
    out.sh_degree = head.metadata.sh_degree;
    out.part_ticks = context.part_ticks;
    out.begin = context.begin;
    out.first_key = context.first_key;
    for (const RecordDecoder& decoder : decoders) {
      if (!decoder.code(out.records.emplace_back())) break;
    }
  }
  const bool good = found.ok();
  findings.append(std::move(found));
  return good;
}

bool decode_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                    Gaussians4D& set, Findings& findings) {
  const IndexEntry& entry = head.index.segments[ordinal].base;
  Findings found;
  std::vector<RecordDecoder> decoders;
  bool sizes_good = true;
  for (const SegmentRecord* record : {&records.base, &records.harmonics}) {
    if (record->bytes.empty()) continue;
    decoders.emplace_back(*record, head.layouts, ordinal, entry.primitives, found);
    sizes_good &= decoders.back().check_sizes();
  }
  if (sizes_good) {
    set.sh_degree = head.metadata.sh_degree;
    set.resize(entry.primitives);
    const SegmentContext context = context_of(records, head, ordinal);
    std::vector<DecodedPlanes> planes(decoders.size());
    std::vector<StreamTask> tasks;
    for (std::size_t d = 0; d < decoders.size(); ++d) {
      if (decoders[d].decode(planes[d])) decoders[d].add_tasks(planes[d], tasks);
    }
    if (found.ok()) map_all(tasks, context, ordinal, entry.offset, set, found);
  }
  const bool good = found.ok();
  findings.append(std::move(found));
  return good;
}

}  // namespace stgs
