// SPDX-License-Identifier: Apache-2.0
// Files with a modified head or index, including content that no writer produces.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "catch.h"
#include "container/container.h"
#include "core/bytes.h"
#include "fixtures/copy_fixture.h"

namespace stgs::testing {

inline FileHead head_of(const std::vector<std::uint8_t>& bytes) {
  Findings findings;
  FileHead head;
  REQUIRE(read_head(*memory_source(bytes), {}, head, findings));
  REQUIRE(findings.ok());
  return head;
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
  for (const auto& record : records) header.head_bytes += record.size();
  header.file_bytes = header.head_bytes + body.size();
  std::vector<std::uint8_t> out = write_header(header);
  for (const auto& record : records) out.insert(out.end(), record.begin(), record.end());
  out.insert(out.end(), body.begin(), body.end());
  return out;
}

// The file with this INDX payload, without the copy of its head; the header states the new sizes.
inline std::vector<std::uint8_t> with_index(const std::vector<std::uint8_t>& bytes,
                                            std::span<const std::uint8_t> payload) {
  const std::span<const std::uint8_t> all = std::span(bytes).first(copy_at(bytes));
  ByteReader header(all.subspan(24));
  const std::uint64_t head_bytes = header.u64();
  std::vector<std::vector<std::uint8_t>> records;
  for (std::uint64_t at = kHeaderBytes; at < head_bytes;) {
    ByteReader in(all.subspan(at));
    const std::uint32_t tag = in.u32();
    in.u32();
    const std::uint64_t size = kRecordHeaderBytes + in.u64();
    REQUIRE(size <= head_bytes - at);
    const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(at);
    records.emplace_back(begin, begin + static_cast<std::ptrdiff_t>(size));
    if (tag == kIndexTag) records.back() = write_record(kIndexTag, payload);
    at += size;
  }
  return file_of(records, all.subspan(head_bytes));
}
inline std::vector<std::uint8_t> with_index(const std::vector<std::uint8_t>& bytes,
                                            const FileHead& head) {
  return with_index(bytes, write_index(head.index, head.parts));
}

}  // namespace stgs::testing
