// SPDX-License-Identifier: Apache-2.0
// Further records of a private content (spec 5.7).
#include "container/segment.h"
#include "core/bytes.h"
#include "core/read_bytes.h"
#include "stgs/format/text.h"

namespace stgs {
namespace {

using N = IssueNumber;

}  // namespace

bool read_listed(const ByteSource& source, const FileHead& head, const IndexEntry& entry,
                 std::vector<std::uint8_t>& bytes, Findings& findings) {
  if (!head.has(entry)) {
    findings.error(N::kFileSize, entry.offset, "the file is truncated within a record of {} bytes",
                   entry.bytes);
    return false;
  }
  if (entry.bytes - kRecordHeaderBytes > head.limits.max_memory) {
    findings.unsupported(N::kMemoryLimit, entry.offset,
                         "record of {} bytes exceeds the memory limit of {} bytes",
                         entry.bytes - kRecordHeaderBytes, head.limits.max_memory);
    return false;
  }
  if (const Status status = read_bytes(source, entry.offset, entry.bytes, bytes); !status.ok()) {
    findings.failed_read(entry.offset, status);
    return false;
  }
  RecordHeader record;
  if (!parse_record_header(bytes, entry.offset, entry.offset + entry.bytes, record, findings))
    return false;
  if (record.tag != kSegmentTag || record.length != entry.bytes - kRecordHeaderBytes) {
    findings.error(N::kSegmentMismatch, entry.offset,
                   "record '{}' of {} bytes does not match its index entry", tag_text(record.tag),
                   record.length);
    return false;
  }
  return check_flags(record, true, entry.offset, findings) &&
         check_payload(record, std::span(bytes).subspan(kRecordHeaderBytes),
                       entry.offset + kRecordHeaderBytes, findings);
}

bool read_further(const ByteSource& source, const FileHead& head, const FurtherEntry& further,
                  FurtherRecord& out, Findings& findings) {
  const IndexEntry& entry = further.entry;
  std::vector<std::uint8_t> bytes;
  if (!read_listed(source, head, entry, bytes, findings)) return false;
  ByteReader in(std::span<const std::uint8_t>(bytes).subspan(kRecordHeaderBytes));
  const auto level = static_cast<std::int16_t>(in.u16());
  const std::uint16_t layer = in.u16();
  const std::uint32_t slot = in.u32();
  const bool is_private = content_of(entry.layer) >= kFirstPrivateContent;
  if (!in.ok() && !is_private) return true;
  if (!in.ok()) {
    findings.error(N::kStreamTable, entry.offset, "further record is too short");
    return false;
  }
  if (level != entry.level || layer != entry.layer || slot != entry.slot) {
    findings.error(N::kSegmentMismatch, entry.offset,
                   "record of content {} does not match its index entry", content_of(entry.layer));
    return false;
  }
  if (!is_private) return true;
  out.times = {in.f64(), in.f64()};
  out.type = in.string();
  const TickRange interval = interval_of(head, entry, further.part);
  if (!in.ok() || !is_utf8(out.type) || !(interval.begin <= out.times.begin) ||
      !(out.times.begin <= out.times.end) || !(out.times.end <= interval.end)) {
    findings.error(
        N::kFurtherRecord, entry.offset,
        "further record is truncated, of an invalid type or outside its segment (ticks {} to "
        "{}, segment {} to {})",
        out.times.begin, out.times.end, interval.begin, interval.end);
    return false;
  }
  const auto data = in.bytes(in.left());
  out.data.assign(data.begin(), data.end());
  return true;
}

}  // namespace stgs
