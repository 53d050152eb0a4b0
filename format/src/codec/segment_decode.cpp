// SPDX-License-Identifier: Apache-2.0
// Decoding a segment: from the bytes of its records to planes, and from planes to primitives (spec
// 7).
#include <algorithm>
#include <memory>
#include <optional>

#include "codec/draco_points.h"
#include "codec/values.h"
#include "codec/zstd_frame.h"
#include "container/segment.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

using N = IssueNumber;

// Returns the problem of the stored bytes of a stream that is not rANS (spec 7.2), or null.
// Allocates nothing. `n`: primitives.
const char* stored_problem(std::span<const std::uint8_t> stored, const StreamRow& row,
                           std::size_t n) {
  if (static_cast<Coder>(row.coder) == Coder::kDraco) {
    return draco_fits(stored, n) ? nullptr : "point cloud does not match the number of primitives";
  }
  const std::uint64_t size = std::uint64_t{n} * row.planes();
  return stored.size() == size ? nullptr : zstd_frame_problem(stored, size);
}

// Decodes `stored`, the raw planes or a frame of them (spec 7.2). Returns the problem, or null.
const char* unpack(std::span<const std::uint8_t> stored, std::span<std::uint8_t> planes) {
  if (stored.size() == planes.size()) {
    std::copy(stored.begin(), stored.end(), planes.begin());
    return nullptr;
  }
  return zstd_unpack(stored, planes);
}

// The decoded planes of a record.
struct DecodedPlanes {
  std::unique_ptr<std::uint8_t[]> symbols;  // of the planes that are not constant, in order
  std::size_t size = 0;                     // of `symbols`
  std::vector<std::vector<Plane>> planes;   // by row
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

  // Checks that the bytes can contain the planes. Call it for all records of a segment before
  // allocating memory for its primitives.
  bool check_sizes() {
    bool good = true;
    for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
      const StreamRow& row = layout_.streams[i];
      if (row.optional() || row.in_group()) continue;
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
    out.size = n_ * layout_.varying_planes(set_);
    out.symbols = std::make_unique_for_overwrite<std::uint8_t[]>(out.size);
    const std::vector<std::span<std::uint8_t>> areas = assign_planes(out);
    if (!decode_bytes(areas)) return false;
    for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
      const StreamRow& row = layout_.streams[i];
      if (row.in_group()) decode_coded(row, areas[i].data());
    }
    if (!group_ends()) return false;
    if (checksum({out.symbols.get(), out.size}) == record_.checksum) return true;
    findings_.error(N::kStreamChecksum, record_.payload_at,
                    "segment {}: decoded planes do not match their checksum", ordinal_);
    return false;
  }

  // Adds the streams to map. `decoded` must outlive them.
  void add_tasks(const DecodedPlanes& decoded, std::vector<StreamTask>& tasks) const {
    for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
      if (layout_.streams[i].optional()) continue;
      tasks.push_back({&layout_.streams[i], decoded.planes[i].data()});
    }
  }

  // Converts the record for a decoder on another device. Call check_sizes() first.
  bool code(CodedRecord& out) const {
    std::vector<std::span<std::uint8_t>> areas(layout_.streams.size());
    std::size_t stored = 0;
    for (const StreamRow& row : layout_.streams) {
      if (!row.in_group()) stored += row.planes();
    }
    out.stored.resize(n_ * stored);
    std::uint32_t in_group = 0, in_stored = 0;
    for (std::size_t i = 0; i < layout_.streams.size(); ++i) {
      const StreamRow& row = layout_.streams[i];
      if (row.optional()) continue;
      if (!row.in_group()) {
        areas[i] = std::span(out.stored).subspan(n_ * in_stored, n_ * row.planes());
      }
      out.streams.push_back(coded_stream(row, in_group, in_stored, out.tables));
    }
    out.bytes.assign(record_.group.begin(), record_.group.end());
    if (layout_.has_group()) {
      Result<std::vector<RansBlockLocation>> blocks = rans_layout(record_.group, n_);
      if (!blocks.ok()) return corrupt("rANS", blocks.status().message().c_str()), false;
      out.blocks = std::move(*blocks);
      // Decoding planes checks the ends of blocks. If all are constant it must be done here.
      if (in_group == 0 && !group_ends()) return false;
    }
    out.own_tables = record_.has_own;
    if (record_.has_own) out.lookups = set_.lookups;
    return decode_bytes(areas);
  }

 private:
  // Checks the ends of blocks after the last plane (spec A.5).
  bool group_ends() const {
    if (!group_ || group_->finish()) return true;
    corrupt("rANS", "a block does not end correctly");
    return false;
  }

  // Converts a row. Advances the numbers of planes in the group and of stored planes.
  CodedStream coded_stream(const StreamRow& row, std::uint32_t& in_group, std::uint32_t& in_stored,
                           std::vector<std::uint16_t>& tables) const {
    CodedStream out;
    out.attribute = static_cast<Attribute>(row.attribute);
    out.mapping = static_cast<Mapping>(row.mapping);
    out.prediction = static_cast<Prediction>(row.prediction);
    out.step = row.step;
    out.components = row.components;
    out.digits = row.digits;
    out.digit_bits = row.digit_bits;
    std::copy_n(row.origin, 3, out.origin.begin());
    for (std::size_t p = 0; p < row.planes(); ++p) {
      const std::int16_t only = row.in_group() ? set_.only[row.tables[p]] : std::int16_t{-1};
      if (!row.in_group()) {
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

  // Returns the memory of the planes of each row.
  std::vector<std::span<std::uint8_t>> assign_planes(DecodedPlanes& out) const {
    std::vector<std::span<std::uint8_t>> areas;
    std::uint8_t* at = out.symbols.get();
    for (const StreamRow& row : layout_.streams) {
      std::uint8_t* const begin = at;
      std::vector<Plane>& planes = out.planes.emplace_back();
      for (std::size_t p = 0; p < row.planes(); ++p) {
        const std::int16_t only = row.in_group() ? set_.only[row.tables[p]] : std::int16_t{-1};
        planes.push_back(only < 0 ? Plane{at, 0} : Plane{nullptr, static_cast<std::uint8_t>(only)});
        at += only < 0 ? n_ : 0;
      }
      areas.emplace_back(begin, at);
    }
    return areas;
  }

  void decode_coded(const StreamRow& row, std::uint8_t* at) {
    for (const std::uint16_t table : row.tables) {
      if (set_.only[table] >= 0) continue;
      group_->next_plane(set_.lookups[table], at);
      at += n_;
    }
  }

  // Decodes the streams that are not rANS.
  bool decode_bytes(const std::vector<std::span<std::uint8_t>>& areas) const {
    if (std::all_of(layout_.streams.begin(), layout_.streams.end(),
                    [](const StreamRow& row) { return row.in_group(); }))
      return true;
    std::vector<const char*> problems(areas.size());
    parallel_for(std::size_t{0}, areas.size(), [&](std::size_t i) {
      const StreamRow& row = layout_.streams[i];
      if (row.optional() || row.in_group()) return;
      problems[i] = static_cast<Coder>(row.coder) == Coder::kDraco
                        ? draco_decode(record_.streams[i], n_, areas[i])
                        : unpack(record_.streams[i], areas[i]);
    });
    for (std::size_t i = 0; i < areas.size(); ++i) {
      if (problems[i] == nullptr) continue;
      corrupt(name_of(static_cast<Attribute>(layout_.streams[i].attribute)), problems[i]);
      return false;
    }
    return true;
  }

  void corrupt(const char* stream, const char* problem) const {
    findings_.error(N::kStreamCorrupt, record_.payload_at, "segment {}, {}: {}", ordinal_, stream,
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
  out.begin = begin_of(segment.base.level, segment.base.slot, head.chunk_of(segment.part));
  out.first_key = records.base.first_key;
  return out;
}

void map_all(const std::vector<StreamTask>& tasks, const SegmentContext& context,
             std::uint32_t ordinal, std::uint64_t offset, Gaussians4D& set, Findings& findings) {
  const MapResult result = map_streams(tasks, context, set);
  for (std::size_t t = 0; t < tasks.size(); ++t) {
    if (result.in_range[t]) continue;
    findings.error(N::kStreamValue, offset, "segment {}, {}: integer out of range", ordinal,
                   name_of(static_cast<Attribute>(tasks[t].row->attribute)));
  }
  if (!result.renderable) check_primitives(set, ordinal, offset, findings);
}

}  // namespace

bool code_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                  CodedSegment& out, Findings& findings) {
  Findings found;
  std::vector<RecordDecoder> decoders;
  bool sizes_good = true;
  for (const SegmentRecord* record : {&records.base, &records.sh}) {
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
  for (const SegmentRecord* record : {&records.base, &records.sh}) {
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
