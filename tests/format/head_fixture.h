// SPDX-License-Identifier: Apache-2.0
// Files with a modified head or index, including content that no writer produces.
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <span>
#include <vector>

#include "catch.h"
#include "container/node.h"
#include "fixtures/copy_fixture.h"

namespace stgs::testing {

inline FileHead head_of(const std::vector<std::uint8_t>& bytes) {
  Findings findings;
  FileHead head;
  REQUIRE(read_head(*memory_source(bytes), {}, IndexLoading::kComplete, head, findings));
  REQUIRE(findings.ok());
  return head;
}

// A growing file without fragments: a header and META.
inline std::vector<std::uint8_t> growing_head(const FileMetadata& metadata) {
  const std::vector<std::uint8_t> meta = write_record(kMetadataTag, write_metadata(metadata));
  FileHeader header;
  header.flags = kGrowing;
  header.head_bytes = static_cast<std::uint32_t>(kHeaderBytes + meta.size());
  std::vector<std::uint8_t> out = write_header(header);
  out.insert(out.end(), meta.begin(), meta.end());
  return out;
}

// The bytes after the head, without the copy of the head.
inline std::vector<std::uint8_t> body_of(const std::vector<std::uint8_t>& bytes) {
  return {bytes.begin() + static_cast<std::ptrdiff_t>(head_of(bytes).header.head_bytes),
          bytes.begin() + static_cast<std::ptrdiff_t>(copy_at(bytes))};
}

// A file whose head consists of these records; the header states the resulting sizes.
inline std::vector<std::uint8_t> file_of(const std::vector<std::vector<std::uint8_t>>& records,
                                         std::span<const std::uint8_t> body = {}) {
  FileHeader header;
  header.head_bytes = kHeaderBytes;
  for (const auto& record : records) header.head_bytes += static_cast<std::uint32_t>(record.size());
  header.file_bytes = header.head_bytes + body.size();
  std::vector<std::uint8_t> out = write_header(header);
  for (const auto& record : records) out.insert(out.end(), record.begin(), record.end());
  out.insert(out.end(), body.begin(), body.end());
  return out;
}

// The payload of INDX for the parts and segments of a head, in one node. `shift` is added to the
// offsets.
inline std::vector<std::uint8_t> index_payload(FileHead head, std::uint64_t shift = 0) {
  IndexNode root;
  std::vector<IndexRun> runs;
  for (const PartEntry& part : head.parts) runs.push_back({part});
  for (SegmentEntry& segment : head.index.segments) {
    segment.base.offset += shift;
    ++runs[segment.part].segments;
  }
  for (FurtherEntry& further : head.index.further) {
    further.entry.offset += shift;
    ++runs[further.part].further;
  }
  const auto by_part = [](const auto& a, const auto& b) { return a.part < b.part; };
  root.segments = head.index.segments;
  root.further = head.index.further;
  std::stable_sort(root.segments.begin(), root.segments.end(), by_part);
  std::stable_sort(root.further.begin(), root.further.end(), by_part);
  std::copy_if(runs.begin(), runs.end(), std::back_inserter(root.runs),
               [](const IndexRun& run) { return run.segments + run.further > 0; });
  return write_index(head.index, root);
}

// A file of META and an index with the parts and segments of `head`, whose records follow each
// other, and this body.
inline std::vector<std::uint8_t> file_with(FileHead head, std::uint32_t frames,
                                           std::span<const std::uint8_t> body) {
  FileMetadata metadata;
  metadata.scene.frames = frames;
  const auto meta = write_record(kMetadataTag, write_metadata(metadata));
  std::uint64_t at = 0;
  for (SegmentEntry& segment : head.index.segments) {
    segment.base.offset = at;
    at += segment.base.bytes;
  }
  std::vector<std::uint8_t> index;
  for (std::uint64_t size = 1; size != index.size();) {
    size = index.size();
    index = write_record(kIndexTag, index_payload(head, kHeaderBytes + meta.size() + size));
  }
  return file_of({meta, index}, body);
}

// The file with the index of this head, without the copy of its head, and with another record at
// its beginning; offsets follow the size of the head.
inline std::vector<std::uint8_t> with_index(const std::vector<std::uint8_t>& bytes,
                                            const FileHead& head,
                                            const std::vector<std::uint8_t>& first = {}) {
  const std::span<const std::uint8_t> all = std::span(bytes).first(copy_at(bytes));
  const std::uint32_t head_bytes = get<std::uint32_t>(bytes, 24);
  std::vector<std::vector<std::uint8_t>> records = {first};
  std::size_t index = 0;
  for (std::uint64_t at = kHeaderBytes; at < head_bytes;) {
    ByteReader in(all.subspan(at));
    const std::uint32_t tag = in.u32();
    in.u32();
    const std::uint64_t size = kRecordHeaderBytes + in.u64();
    REQUIRE(size <= head_bytes - at);
    const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(at);
    if (tag == kIndexTag) index = records.size();
    records.emplace_back(begin, begin + static_cast<std::ptrdiff_t>(size));
    at += size;
  }
  const std::uint64_t before = records[index].size() - first.size();
  for (std::uint64_t size = 0; size != records[index].size();) {
    size = records[index].size();
    records[index] = write_record(kIndexTag, index_payload(head, size - before));
  }
  return file_of(records, all.subspan(head_bytes));
}

}  // namespace stgs::testing
