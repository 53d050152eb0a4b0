// SPDX-License-Identifier: Apache-2.0
#include "segment.h"

#include <algorithm>

#include "bytes.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

using N = IssueNumber;

StreamEntry read_entry(ByteReader& in) {  // spec 6.2
  StreamEntry entry;
  entry.attribute = in.u16();
  entry.components = in.u8();
  entry.mapping = in.u8();
  entry.prediction = in.u8();
  entry.coder = in.u8();
  entry.digit_bits = in.u8();
  entry.digits = in.u8();
  entry.exponent = static_cast<std::int8_t>(in.u8());
  entry.bytes = in.u64();
  entry.checksum = in.u64();
  for (float& v : entry.origin) v = in.f32();
  return entry;
}

void write_entry(const StreamEntry& entry, ByteWriter& out) {
  out.u16(entry.attribute);
  out.u8(entry.components);
  out.u8(entry.mapping);
  out.u8(entry.prediction);
  out.u8(entry.coder);
  out.u8(entry.digit_bits);
  out.u8(entry.digits);
  out.u8(static_cast<std::uint8_t>(entry.exponent));
  out.u64(entry.bytes);
  out.u64(entry.checksum);
  for (float v : entry.origin) out.f32(v);
}

bool same_segment(ByteReader& in, const IndexEntry& expected, std::uint32_t& streams) {
  const auto level = static_cast<std::int16_t>(in.u16());
  const std::uint16_t layer = in.u16();
  const std::uint32_t slot = in.u32(), primitives = in.u32();
  streams = in.u32();
  return level == expected.level && layer == expected.layer && slot == expected.slot &&
         primitives == expected.primitives;
}

// What a record may hold of the attributes of a set of this degree.
std::span<const Attribute> attributes_in(const IndexEntry& entry, int sh_degree) {
  const std::span<const Attribute> all = attributes_of(sh_degree);
  const bool harmonics = content_of(entry.layer) == static_cast<int>(Content::kHarmonics);
  return harmonics ? all.subspan(attributes_of(0).size()) : all;
}

// Reads one record, checks it against its index row and appends its streams.
bool read_record(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                 const IndexEntry& entry, std::vector<std::uint8_t>& record,
                 std::vector<LocatedStream>& streams, Findings& findings) {
  if (entry.offset > source.size() || entry.bytes > source.size() - entry.offset) {
    findings.error(N::kSegmentRange, entry.offset, "segment {}: {} bytes are cut off", ordinal,
                   entry.bytes);
    return false;
  }
  record.resize(entry.bytes);
  if (Status status = source.read(entry.offset, record); !status.ok()) {
    findings.failed_read(entry.offset, status);
    return false;
  }
  RecordHeader header;
  if (!parse_record_header(record, entry.offset, entry.offset + entry.bytes, header, findings)) {
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
  const auto payload = std::span<const std::uint8_t>(record).subspan(kRecordHeaderBytes);
  const std::uint64_t payload_at = entry.offset + kRecordHeaderBytes;
  if (checksum(payload) != header.checksum) {
    findings.error(N::kRecordChecksum, payload_at, "segment {} is damaged (checksum of {} bytes)",
                   ordinal, payload.size());
  }
  return parse_segment(payload, payload_at, ordinal, entry, head.metadata, streams, findings);
}

}  // namespace

std::vector<std::uint8_t> write_segment(const IndexEntry& entry,
                                        std::span<const EncodedStream> streams) {
  ByteWriter out;
  out.u16(static_cast<std::uint16_t>(entry.level));
  out.u16(entry.layer);
  out.u32(entry.slot);
  out.u32(entry.primitives);
  out.u32(static_cast<std::uint32_t>(streams.size()));
  for (const EncodedStream& stream : streams) write_entry(stream.entry, out);
  for (const EncodedStream& stream : streams) out.bytes(stream.bytes);
  return out.take();
}

bool parse_segment(std::span<const std::uint8_t> payload, std::uint64_t offset,
                   std::uint32_t ordinal, const IndexEntry& expected, const FileMetadata& metadata,
                   std::vector<LocatedStream>& streams, Findings& findings) {
  ByteReader in(payload);
  std::uint32_t count = 0;
  if (!same_segment(in, expected, count)) {
    findings.error(N::kSegmentMismatch, offset, "segment {}: is not the one that the index lists",
                   ordinal);
    return false;
  }
  if (!in.ok() || in.left() / kStreamEntryBytes < count) {
    findings.error(N::kStreamTable, offset, "segment {}: {} bytes are too few for {} streams",
                   ordinal, payload.size(), count);
    return false;
  }
  const std::span<const Attribute> needed = attributes_in(expected, metadata.sh_degree);
  std::size_t found = 0, kept = streams.size();
  std::uint64_t at = kSegmentHeaderBytes + std::uint64_t{kStreamEntryBytes} * count;
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint64_t row = offset + in.position();
    LocatedStream stream{read_entry(in), offset + at, {}};
    if (stream.entry.bytes > payload.size() - at) {
      findings.error(N::kStreamTable, row, "segment {}: stream {} of {} bytes does not fit",
                     ordinal, i, stream.entry.bytes);
      return false;
    }
    stream.stored = payload.subspan(at, stream.entry.bytes);
    at += stream.entry.bytes;
    if (stream.entry.attribute >= kOptionalAttributes) continue;  // spec 6.4
    if (found == needed.size() ||
        stream.entry.attribute != static_cast<std::uint16_t>(needed[found])) {
      findings.error(N::kStreamMissing, row, "segment {}: stream {} has attribute {}; expected {}",
                     ordinal, i, stream.entry.attribute,
                     found == needed.size() ? "no more" : name_of(needed[found]));
      return false;
    }
    ++found;
    if (check_entry(stream.entry, {ordinal, row}, findings)) streams.push_back(stream);
  }
  if (at != payload.size()) {
    findings.error(N::kStreamTable, offset, "segment {}: {} bytes belong to no stream", ordinal,
                   payload.size() - at);
  }
  // The harmonics above degree 0 may be left to a record of their own.
  const bool partial = found == attributes_of(0).size() &&
                       content_of(expected.layer) == static_cast<int>(Content::kPrimitives);
  if (found != needed.size() && !partial) {
    findings.error(N::kStreamMissing, offset, "segment {}: no stream for {}", ordinal,
                   name_of(needed[found]));
    return false;
  }
  return streams.size() - kept == found;
}

bool decode_streams(std::span<const LocatedStream> streams, std::uint32_t ordinal,
                    std::uint32_t primitives, const FileMetadata& metadata, Gaussians4D& set,
                    Findings& findings) {
  // All streams of a segment must be able to fill it before any memory of its size is taken.
  bool sizes_good = true;
  for (const LocatedStream& stream : streams) {
    sizes_good &=
        check_size(stream.entry, stream.stored, primitives, {ordinal, stream.offset}, findings);
  }
  if (!sizes_good) return false;
  set.sh_degree = metadata.sh_degree;
  set.resize(primitives);
  std::vector<Findings> found(streams.size());
  const auto decode = [&](std::size_t i) {
    const LocatedStream& stream = streams[i];
    const StreamPlace place{ordinal, stream.offset};
    std::vector<std::uint8_t> planes;
    if (decode_planes(stream.entry, stream.stored, primitives, place, planes, found[i])) {
      map_planes(stream.entry, planes, metadata.scene.frames, place, set, found[i]);
    }
  };
  // Velocity is scaled by the lifespan and rotation by the shape: they come after these.
  const auto waits = [&](std::size_t i) {
    const auto attribute = static_cast<Attribute>(streams[i].entry.attribute);
    return attribute == Attribute::kVelocity || attribute == Attribute::kRotation;
  };
  for (const bool second : {false, true}) {
    parallel_for(std::size_t{0}, streams.size(), [&](std::size_t i) {
      if (waits(i) == second) decode(i);
    });
  }
  const bool good = std::all_of(found.begin(), found.end(), [](auto& f) { return f.ok(); });
  for (Findings& f : found) findings.append(std::move(f));
  return good;
}

bool read_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                  bool with_harmonics, SegmentRecords& records, Findings& findings) {
  const SegmentEntry& segment = head.index.segments[ordinal];
  if (!read_record(source, head, ordinal, segment.base, records.base, records.streams, findings)) {
    return false;
  }
  const std::size_t all = attributes_of(head.metadata.sh_degree).size();
  const bool whole = records.streams.size() == all, own = segment.harmonics.bytes > 0;
  if (whole == own) {
    findings.error(N::kStreamMissing, segment.base.offset,
                   "segment {}: the harmonics above degree 0 are stored {}", ordinal,
                   own ? "twice" : "nowhere");
    return false;
  }
  if (whole || !with_harmonics) return true;
  return read_record(source, head, ordinal, segment.harmonics, records.harmonics, records.streams,
                     findings);
}

}  // namespace stgs
