// SPDX-License-Identifier: Apache-2.0
// Writing heads with their copies (spec 3.6).
#include <algorithm>

#include "codec/planes.h"
#include "container/container.h"
#include "core/bytes.h"

namespace stgs {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes pack_records(std::span<const std::uint8_t> records) {
  return {records.begin(), records.end()};
}

std::uint64_t payload_bytes(std::span<const std::uint8_t> packed) {
  return kHeaderBytes + packed.size() + kHeadLengthBytes;
}

Bytes write_copy(std::span<const std::uint8_t> header, std::span<const std::uint8_t> packed) {
  ByteWriter payload;
  payload.bytes(header);
  payload.bytes(packed);
  payload.u64(payload_bytes(packed));
  return write_record(kCopyTag, payload.view(), 0);
}

}  // namespace

CopiedHead write_copied_head(FileHeader header, std::span<const std::uint8_t> records,
                             std::uint64_t body_bytes) {
  const Bytes packed = pack_records(records);
  header.minor = std::max(header.minor, kCopyMinor);
  header.head_bytes = kHeaderBytes + records.size();
  if ((header.flags & kGrowing) == 0) {
    header.file_bytes = header.head_bytes + body_bytes + kRecordHeaderBytes + payload_bytes(packed);
  }
  CopiedHead out{write_header(header), {}};
  out.copy = write_copy(out.head, packed);
  out.head.insert(out.head.end(), records.begin(), records.end());
  return out;
}

}  // namespace stgs
