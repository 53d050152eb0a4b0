// SPDX-License-Identifier: Apache-2.0
#include <xxhash.h>

#include "container/container.h"
#include "core/bytes.h"

namespace stgs {

std::uint64_t checksum(std::span<const std::uint8_t> bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

std::vector<std::uint8_t> write_header(const FileHeader& header) {  // spec 2.2
  ByteWriter out;
  out.bytes(kMagic);
  out.u16(header.major);
  out.u16(header.minor);
  out.u32(header.flags);
  out.u64(header.file_bytes);
  out.u64(header.head_bytes);
  out.u64(checksum(out.view()));
  return out.take();
}

std::vector<std::uint8_t> write_record(std::uint32_t tag, std::span<const std::uint8_t> payload,
                                       std::uint32_t flags) {
  ByteWriter out;  // spec 3.1
  out.u32(tag);
  out.u32(flags);
  out.u64(payload.size());
  out.u64(checksum(payload));
  out.u64(checksum(out.view()));
  out.bytes(payload);
  return out.take();
}

std::vector<std::uint8_t> write_importance(std::span<const float> importance,
                                           std::span<const std::uint32_t> order) {  // spec 5.11
  ByteWriter out;
  for (const std::uint32_t i : order) out.f32(importance[i]);
  return out.take();
}

}  // namespace stgs
