// SPDX-License-Identifier: Apache-2.0
#include "container/segment.h"
#include "core/read_bytes.h"

#include <algorithm>

#include "core/bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;

// Reads the first fields. Returns whether those that exist are equal to the index entry's.
bool same_segment(ByteReader& in, const IndexEntry& expected) {
  const auto level = static_cast<std::int16_t>(in.u16());
  const std::uint16_t layer = in.u16();
  const std::uint32_t slot = in.u32();
  if (in.ok() && (level != expected.level || layer != expected.layer || slot != expected.slot)) {
    return false;
  }
  const std::uint32_t primitives = in.u32();
  return !in.ok() || primitives == expected.primitives;
}

bool cut_off(const SegmentRecord& record, std::uint32_t ordinal, std::size_t bytes,
             Findings& findings) {
  findings.error(N::kStreamTable, record.payload_at,
                 "segment {}: payload of {} bytes does not match its fields or the streams of its "
                 "layout",
                 ordinal, bytes);
  return false;
}

// Checks that this version can decode the layout's streams (spec 6.3).
bool check_known(const Layout& layout, std::uint32_t ordinal, std::uint64_t offset,
                 Findings& findings) {
  for (const StreamRow& row : layout.streams) {
    if (row.known || row.optional()) continue;
    findings.unsupported(
        N::kStreamUnsupported, offset,
        "segment {}: unknown attribute {} with mapping {}, prediction {} and coder "
        "{}; a later version is needed",
        ordinal, row.attribute, row.mapping, row.prediction, row.coder);
    return false;
  }
  return true;
}

// Returns whether each table is used by a plane (spec 6.1).
bool names_all_tables(const Layout& layout, std::size_t tables) {
  std::vector<bool> named(tables);
  for (const StreamRow& row : layout.streams) {
    for (const std::uint16_t table : row.tables) named[table] = true;
  }
  return std::all_of(named.begin(), named.end(), [](bool is) { return is; });
}

// Checks that the layout has the streams of the record's content, in order.
bool check_attributes(const Layout& layout, const IndexEntry& entry, int sh_degree,
                      std::uint32_t ordinal, std::uint64_t offset, Findings& findings) {
  const std::span<const Attribute> all = streams_of(sh_degree);
  const std::size_t base = streams_of(0).size();
  const bool sh = content_of(entry.layer) == static_cast<int>(Content::kSh);
  const std::span<const Attribute> needed = sh ? all.subspan(base) : all;
  std::size_t found = 0;
  for (const StreamRow& row : layout.streams) {
    if (row.optional()) continue;
    if (found == needed.size() || row.attribute != static_cast<std::uint16_t>(needed[found])) {
      findings.error(N::kStreamMissing, offset,
                     "segment {}: unexpected attribute {} in its layout (expected {})", ordinal,
                     row.attribute, found == needed.size() ? "no more" : name_of(needed[found]));
      return false;
    }
    ++found;
  }
  // SH above degree 0 may be in a separate record.
  if (found == needed.size() || (!sh && found == base)) return true;
  findings.error(N::kStreamMissing, offset, "segment {}: no stream for {}", ordinal,
                 name_of(needed[found]));
  return false;
}

// Returns whether the layout lacks the SH above degree 0.
bool is_partial(const Layout& layout, int sh_degree) {
  const auto known = std::count_if(layout.streams.begin(), layout.streams.end(),
                                   [](const StreamRow& row) { return !row.optional(); });
  return static_cast<std::size_t>(known) < streams_of(sh_degree).size();
}

// Checks that a layout is allowed by the file's profile (spec 11.1). Unknown profiles allow any.
bool check_profile_of(const Layout& layout, Profile profile, std::uint32_t ordinal,
                      std::uint64_t offset, Findings& findings) {
  for (const StreamRow& row : layout.streams) {
    if (row.optional()) continue;
    const bool draco = static_cast<Coder>(row.coder) == Coder::kDraco;
    const auto mapping = static_cast<Mapping>(row.mapping);
    const bool mapped =
        mapping != Mapping::kInteger && (mapping != Mapping::kFloat || row.step != Step{});
    const bool quantised = profile == Profile::kQuantised || profile == Profile::kNearLossless;
    const bool fits = profile == Profile::kLossless ? !mapped && !draco : !quantised || !draco;
    if (fits) continue;
    findings.error(N::kProfile, offset,
                   "segment {}, {}: mapping {} with coder {} is not allowed by the profile {}",
                   ordinal, name_of(static_cast<Attribute>(row.attribute)), row.mapping, row.coder,
                   profile_name(profile));
    return false;
  }
  return true;
}

// Adds to the memory of a segment (conformance 1.5). Returns false if that exceeds the limit.
bool take_memory(std::uint64_t bytes, const FileHead& head, std::uint32_t ordinal,
                 std::uint64_t offset, std::uint64_t& memory, Findings& findings) {
  const std::uint64_t limit = head.limits.max_memory;
  if (memory <= limit && bytes <= limit - memory) {
    memory += bytes;
    return true;
  }
  findings.unsupported(N::kMemoryLimit, offset,
                       "segment {}: decoding exceeds the memory limit of {} bytes", ordinal, limit);
  return false;
}

// Returns the values of a stream that is not optional.
std::uint64_t values_of(const SegmentRecord& record, const StreamRow& row,
                        std::uint32_t primitives) {
  const int band = band_of(static_cast<Attribute>(row.attribute));
  return band == 0 ? primitives : record.sh[static_cast<std::size_t>(band - 1)];
}

// Returns the memory of a record's planes that take bytes.
std::uint64_t plane_memory(const SegmentRecord& record, const LayoutSet& set,
                           std::uint32_t primitives) {
  std::uint64_t bytes = 0;
  for (const StreamRow& row : set.layouts[record.layout].streams) {
    if (!row.optional())
      bytes += values_of(record, row, primitives) * Layout::varying_planes(row, set);
  }
  return bytes;
}

// Reads the fields after the layout (spec 6.5). Returns false if it contradicts itself or the
// payload.
bool read_units(ByteReader& in, const Layout& layout, int sh_degree, std::uint32_t primitives,
                SegmentRecord& record) {
  std::uint32_t most = primitives;
  for (int k = 0; layout.has_sh_degree() && k < sh_degree; ++k) {
    const std::uint32_t count = in.u32();
    if (count > most) return false;
    record.sh[static_cast<std::size_t>(k)] = most = count;
  }
  if (layout.has_first_key()) record.first_key = in.u32();
  const std::vector<Layout::Unit> units = layout.units();
  std::vector<std::uint32_t> sizes(units.size());
  for (std::uint32_t& size : sizes) size = in.u32();
  for (std::size_t u = 0; u < units.size(); ++u)
    record.units.push_back({units[u], in.bytes(sizes[u])});
  return in.ok();
}

// Finds the record's layout and the bytes of its streams (spec 6.5). `memory`: see SegmentRecords.
bool parse_segment(std::span<const std::uint8_t> payload, const FileHead& head,
                   std::uint32_t ordinal, const IndexEntry& expected, SegmentRecord& record,
                   std::uint64_t& memory, Findings& findings) {
  ByteReader in(payload);
  if (!same_segment(in, expected)) {
    findings.error(N::kSegmentMismatch, record.payload_at,
                   "segment {}: record does not match its index entry", ordinal);
    return false;
  }
  record.layout = in.u16();
  if (!in.ok()) return cut_off(record, ordinal, payload.size(), findings);
  record.has_own = record.layout == kOwnLayout;
  if (record.has_own) {
    Findings found;
    if (!parse_layouts(in, record.payload_at, kMaxOwnTables, 1, head.limits.max_memory - memory,
                       record.own, found)) {
      if (!in.ok()) return cut_off(record, ordinal, payload.size(), findings);
      findings.append(std::move(found));
      return false;
    }
    memory += record.own.tables.size() * kTableMemory;
    record.layout = 0;
  }
  const std::vector<Layout>& layouts = record.set(*head.layouts).layouts;
  if (record.layout >= layouts.size() || (record.has_own && layouts.size() != 1)) {
    findings.error(N::kLayouts, record.payload_at,
                   "segment {}: invalid layout number {} (there are {} layouts)", ordinal,
                   record.layout, layouts.size());
    return false;
  }
  const Layout& layout = layouts[record.layout];
  if (layout.problem != 0) {
    findings.error(static_cast<N>(layout.problem), record.payload_at, "segment {}: {}", ordinal,
                   layout.why);
    return false;
  }
  if (record.has_own && !names_all_tables(layout, record.own.tables.size())) {
    findings.error(N::kLayouts, record.payload_at,
                   "segment {}: its layout does not use all of its {} tables", ordinal,
                   record.own.tables.size());
    return false;
  }
  if (!check_known(layout, ordinal, record.payload_at, findings) ||
      !check_attributes(layout, expected, head.metadata.sh_degree, ordinal, record.payload_at,
                        findings) ||
      !check_profile_of(layout, head.metadata.profile, ordinal, record.payload_at, findings)) {
    return false;
  }
  if (read_units(in, layout, head.metadata.sh_degree, expected.primitives, record)) {
    return take_memory(plane_memory(record, record.set(*head.layouts), expected.primitives), head,
                       ordinal, record.payload_at, memory, findings);
  }
  return cut_off(record, ordinal, payload.size(), findings);
}

bool is_available(const FileHead& head, std::uint32_t ordinal, const IndexEntry& entry,
                  Findings& findings) {
  if (head.has(entry)) return true;
  findings.error(N::kFileSize, entry.offset,
                 "segment {}: the file is truncated within its {} bytes", ordinal, entry.bytes);
  return false;
}

// Reads one record and checks it against its index entry.
bool read_record(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                 const IndexEntry& entry, SegmentRecord& record, std::uint64_t& memory,
                 Findings& findings) {
  if (!is_available(head, ordinal, entry, findings) ||
      !take_memory(entry.bytes, head, ordinal, entry.offset, memory, findings)) {
    return false;
  }
  if (Status status = read_bytes(source, entry.offset, entry.bytes, record.bytes); !status.ok()) {
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
                   "segment {}: record '{}' of {} bytes does not match its index entry", ordinal,
                   tag_text(header.tag), header.length);
    return false;
  }
  if ((header.flags & kCritical) == 0) {  // listed records cannot be skipped
    findings.error(N::kNotCritical, entry.offset, "segment {} is not marked critical", ordinal);
    return false;
  }
  if (!check_flags(header, true, entry.offset, findings)) return false;
  const auto payload = std::span<const std::uint8_t>(record.bytes).subspan(kRecordHeaderBytes);
  record.payload_at = entry.offset + kRecordHeaderBytes;
  if (checksum(payload) != header.checksum) {
    findings.error(N::kRecordChecksum, record.payload_at,
                   "segment {} is damaged (checksum mismatch over {} bytes)", ordinal,
                   payload.size());
  }
  return parse_segment(payload, head, ordinal, entry, record, memory, findings);
}

}  // namespace

bool read_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                  bool with_sh, SegmentRecords& records, Findings& findings) {
  const SegmentEntry& segment = head.segment(ordinal);
  records.memory = 0;
  if (!is_available(head, ordinal, segment.base, findings) ||
      !take_memory(4 * floats_per_primitive(head.metadata.sh_degree) * segment.base.primitives,
                   head, ordinal, segment.base.offset, records.memory, findings) ||
      !read_record(source, head, ordinal, segment.base, records.base, records.memory, findings)) {
    return false;
  }
  const bool partial = is_partial(records.base.layout_in(*head.layouts), head.metadata.sh_degree);
  const bool own = segment.sh.bytes > 0;
  if (partial != own) {
    findings.error(N::kStreamMissing, segment.base.offset, "segment {}: SH above degree 0 are {}",
                   ordinal, own ? "stored twice" : "missing");
    return false;
  }
  if (!own || !with_sh) return true;
  return read_record(source, head, ordinal, segment.sh_entry(), records.sh, records.memory,
                     findings);
}

std::uint64_t decoded_values(const SegmentRecords& records, const FileHead& head,
                             std::uint32_t ordinal) {
  const std::uint32_t primitives = head.segment(ordinal).base.primitives;
  std::uint64_t out = kPrimitiveWork * std::uint64_t{primitives};
  for (const SegmentRecord* record : {&records.base, &records.sh}) {
    if (record->bytes.empty()) continue;
    for (const StreamRow& row : record->layout_in(*head.layouts).streams) {
      if (row.optional()) continue;
      const auto floats =
          static_cast<std::size_t>(components_of(static_cast<Attribute>(row.attribute)));
      const std::size_t planes = Layout::varying_planes(row, record->set(*head.layouts));
      const bool draco = static_cast<Coder>(row.coder) == Coder::kDraco;
      const std::uint64_t values = values_of(*record, row, primitives);
      // With few lanes, each symbol waits for the one before.
      const std::uint64_t symbol = 1 + std::min<std::uint64_t>(4, 8 / rans_lanes(values));
      out += values * (draco ? kDracoWork : floats + symbol * planes);
      out += kPlaneWork * row.planes();
      if (record->has_own && values > 0) out += kLookupWork * planes;
    }
    out += kRecordWork + kOwnTableWork * record->own.tables.size();
  }
  return out;
}

}  // namespace stgs
