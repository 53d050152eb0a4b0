// SPDX-License-Identifier: Apache-2.0
// Writing the header and records (spec 2.1, 3.1).
#include "container/container.h"
#include "core/bytes.h"

namespace stgs {

std::vector<std::uint8_t> write_header(const FileHeader& header) {
  ByteWriter out;
  out.bytes(kMagic);
  out.u16(header.major);
  out.u16(header.minor);
  out.u32(header.flags);
  out.u64(header.file_bytes);
  out.u32(header.head_bytes);
  out.u32(checksum(out.view()));
  return out.take();
}

std::vector<std::uint8_t> write_record(std::uint32_t tag, std::span<const std::uint8_t> payload,
                                       std::uint32_t flags) {
  ByteWriter out;
  out.u32(tag);
  out.u32(flags);
  out.u64(payload.size());
  out.u32(checksum(payload));
  out.u32(checksum(out.view()));
  out.bytes(payload);
  return out.take();
}

std::vector<std::uint8_t> write_importance(std::span<const float> importance,
                                           std::span<const std::uint32_t> order) {  // spec 11.9
  ByteWriter out;
  for (const std::uint32_t i : order) out.f32(importance[i]);
  return out.take();
}

std::vector<std::uint8_t> write_finished_head(FileHeader header,
                                              std::span<const std::uint8_t> records,
                                              std::uint64_t copy_at) {
  header.head_bytes = static_cast<std::uint32_t>(kHeaderBytes + records.size());
  header.file_bytes = copy_at + head_copy_bytes(header.head_bytes);
  std::vector<std::uint8_t> head = write_header(header);
  head.insert(head.end(), records.begin(), records.end());
  return head;
}

std::vector<std::uint8_t> write_head_copy(std::span<const std::uint8_t> head) {
  ByteWriter payload;
  payload.bytes(head);
  payload.u64(head.size() + 8);
  return write_record(kCopyTag, payload.view(), 0);
}

}  // namespace stgs
