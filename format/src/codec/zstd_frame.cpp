// SPDX-License-Identifier: Apache-2.0
#include "codec/zstd_frame.h"

#include <zstd.h>

#include <algorithm>

#include "core/bytes.h"

namespace stgs {
namespace {

constexpr std::uint32_t kFrameMagic = 0xFD2FB528;

// Reads a little-endian number of 0, 1, 2, 4 or 8 bytes.
std::uint64_t number_of(ByteReader& in, std::size_t bytes) {
  std::uint64_t v = 0;
  for (std::size_t i = 0; i < bytes; ++i) v |= std::uint64_t{in.u8()} << (8 * i);
  return v;
}

}  // namespace

const char* zstd_frame_problem(std::span<const std::uint8_t> stored, std::uint64_t size) {
  ByteReader in(stored);
  if (in.u32() != kFrameMagic || !in.ok()) return "neither raw planes nor a Zstandard frame";
  const std::uint8_t descriptor = in.u8();
  const bool single_segment = (descriptor & 0x20) != 0;
  if ((descriptor & 0x08) != 0) return "reserved bit set in the frame header";
  if ((descriptor & 0x04) != 0) return "frame has a checksum";
  std::uint64_t window = 0;
  if (!single_segment) {
    const std::uint8_t code = in.u8();
    const std::uint64_t base = std::uint64_t{1} << (10 + (code >> 3));
    window = base + base / 8 * (code & 7);
  }
  constexpr std::size_t kDictionaryBytes[4] = {0, 1, 2, 4}, kContentBytes[4] = {0, 2, 4, 8};
  if (number_of(in, kDictionaryBytes[descriptor & 3]) != 0) return "frame needs a dictionary";
  const std::size_t code = descriptor >> 6;
  if (code == 0 && !single_segment) return "frame does not state its content size";
  std::uint64_t content = number_of(in, code == 0 ? 1 : kContentBytes[code]);
  if (code == 1) content += 256;
  if (!in.ok()) return "frame header is truncated";
  if (content != size) return "frame content does not match the size of the planes";
  if (window > std::max(kMaxWindow, content)) return "frame window is too large";
  if (content > kMaxZstdExpansion * stored.size()) return "frame is too short for its content";
  return nullptr;
}

const char* zstd_unpack(std::span<const std::uint8_t> stored, std::span<std::uint8_t> out) {
  const std::size_t frame = ZSTD_findFrameCompressedSize(stored.data(), stored.size());
  if (ZSTD_isError(frame)) return ZSTD_getErrorName(frame);
  if (frame != stored.size()) return "extra bytes after the frame";
  const std::size_t got = ZSTD_decompress(out.data(), out.size(), stored.data(), stored.size());
  if (ZSTD_isError(got)) return ZSTD_getErrorName(got);
  return got == out.size() ? nullptr : "decoded size is wrong";
}

}  // namespace stgs
