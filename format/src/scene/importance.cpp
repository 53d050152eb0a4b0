// SPDX-License-Identifier: Apache-2.0
#include "scene/importance.h"

#include <algorithm>
#include <numeric>

#include "codec/values.h"

namespace stgs {
namespace {

using N = IssueNumber;

// Finds records after the last segment of a file.
class TailReader {
 public:
  TailReader(const ByteSource& source, const FileHead& head, Findings& findings)
      : source_(source), head_(head), findings_(findings) {}

  // Reads the payload of the first record with this tag, and flags 0. Returns false if there is
  // none, or after an error. `at`: its offset.
  bool read(std::uint32_t tag, std::vector<std::uint8_t>& payload, std::uint64_t& at) const {
    at = head_.header.head_bytes;
    for (const SegmentEntry& segment : head_.index.segments) {
      for (const RecordRange& record : {RecordRange(segment.base), segment.sh})
        at = std::max(at, record.offset + record.bytes);
    }
    for (const FurtherEntry& further : head_.index.further)
      at = std::max(at, further.entry.offset + further.entry.bytes);
    while (at < head_.header.file_bytes) {
      const std::optional<RecordHeader> record = read_header(at);
      if (!record) return false;
      if (record->tag == tag && record->flags == 0) return read_payload(at, *record, payload);
      at += kRecordHeaderBytes + record->length;
    }
    return false;
  }

 private:
  // Returns whether bytes before the stated end of the file are available.
  bool is_available(std::uint64_t at, std::uint64_t bytes) const {
    const std::uint64_t needed = std::min(bytes, head_.header.file_bytes - at);
    if (at <= head_.available_bytes && needed <= head_.available_bytes - at) return true;
    findings_.error(N::kFileSize, at, "the file is truncated after its segments");
    return false;
  }

  bool read_bytes(std::uint64_t at, std::span<std::uint8_t> bytes) const {
    const Status status = source_.read(at, bytes);
    if (!status.ok()) findings_.failed_read(at, status);
    return status.ok();
  }

  std::optional<RecordHeader> read_header(std::uint64_t at) const {
    std::vector<std::uint8_t> bytes(std::min(kRecordHeaderBytes, head_.header.file_bytes - at));
    RecordHeader record;
    if (!is_available(at, kRecordHeaderBytes) || !read_bytes(at, bytes) ||
        !parse_record_header(bytes, at, head_.header.file_bytes, record, findings_)) {
      return {};
    }
    return record;
  }

  bool read_payload(std::uint64_t at, const RecordHeader& record,
                    std::vector<std::uint8_t>& bytes) const {
    if (!is_available(at + kRecordHeaderBytes, record.length)) return false;
    if (record.length > head_.limits.max_memory) {
      findings_.unsupported(N::kMemoryLimit, at,
                            "record '{}' of {} bytes exceeds the memory limit of {} bytes",
                            tag_text(record.tag), record.length, head_.limits.max_memory);
      return false;
    }
    bytes.resize(record.length);
    return read_bytes(at + kRecordHeaderBytes, bytes) &&
           check_payload(record, bytes, at + kRecordHeaderBytes, findings_);
  }

  const ByteSource& source_;
  const FileHead& head_;
  Findings& findings_;
};

// Converts values in the order of the file to that of the segments.
std::vector<float> in_segment_order(const std::vector<float>& in_file_order,
                                    const std::vector<SegmentEntry>& segments) {
  std::vector<std::uint32_t> order(segments.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&segments](std::uint32_t a, std::uint32_t b) {
    return segments[a].base.offset < segments[b].base.offset;
  });
  std::vector<std::size_t> first(segments.size() + 1);
  for (std::size_t s = 0; s < segments.size(); ++s)
    first[s + 1] = first[s] + segments[s].base.primitives;
  std::vector<float> out(in_file_order.size());
  auto from = in_file_order.begin();
  for (const std::uint32_t s : order) {
    const std::uint32_t count = segments[s].base.primitives;
    std::copy_n(from, count, out.begin() + static_cast<std::ptrdiff_t>(first[s]));
    from += count;
  }
  return out;
}

}  // namespace

std::optional<std::vector<std::uint8_t>> find_importance(const ByteSource& source,
                                                         const FileHead& head, Findings& findings) {
  std::vector<std::uint8_t> payload;
  std::uint64_t at = 0;
  if (head.growing() || !TailReader(source, head, findings).read(kImportanceTag, payload, at)) {
    return {};
  }
  (void)parse_importance(payload, head.index.primitives, at, findings);
  return findings.ok() ? std::optional(std::move(payload)) : std::nullopt;
}

Result<std::vector<float>> read_importance(const ByteSource& source, const FileHead& head) {
  if (!head.walk.pending.empty()) {
    return usage_error("{}: importances need the complete index", source.name());
  }
  Findings findings;
  const auto payload = find_importance(source, head, findings);
  std::vector<float> values;
  if (payload) values = parse_importance(*payload, head.index.primitives, 0, findings);
  if (!findings.ok()) return findings.status(source.name());
  if (!values.empty() && head.listed_primitives != head.index.primitives) {
    return invalid_file("{}: the index is damaged, so that importances cannot be assigned",
                        source.name());
  }
  return in_segment_order(values,
                          values.empty() ? std::vector<SegmentEntry>() : head.index.segments);
}

}  // namespace stgs
