// SPDX-License-Identifier: Apache-2.0
// Clause 7.2, coder 0: bytes as they are, or one Zstandard frame of them.
#include <zstd.h>

#include <algorithm>

#include "interchange/stgs1/layouts.h"

namespace stgs::stgs1 {
namespace {

constexpr std::uint32_t kFrame = 0xFD2FB528;
constexpr std::uint64_t kFrameWindow = std::uint64_t{8} << 20, kFrameExpansion = 32768;  // 7.2.2

std::uint64_t number(ByteReader& in, int bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= std::uint64_t{in.u8()} << 8 * i;
  return value;
}

}  // namespace

Status check_stored(View stored, std::uint64_t size) {
  if (stored.size() == size) return {};
  ByteReader in(stored);
  if (in.u32() != kFrame) return invalid_file("a stream is neither raw planes nor a zstd frame");
  const int flags = in.u8();  // RFC 8878, 3.1.1.1.1
  const bool is_single = (flags & 0x20) != 0;
  std::uint64_t window = 0;
  if (!is_single) {
    const int code = in.u8();
    window = (std::uint64_t{1} << (10 + code / 8)) / 8 * static_cast<unsigned>(8 + code % 8);
  }
  constexpr int kDictionary[4] = {0, 1, 2, 4}, kContent[4] = {1, 2, 4, 8};
  const std::uint64_t dictionary = number(in, kDictionary[flags & 3]);
  const int form = flags >> 6;
  const bool states_size = is_single || form != 0;
  const std::uint64_t content =
      states_size ? number(in, kContent[form]) + (form == 1 ? 256 : 0) : 0;
  if (!in.ok() || (flags & 0x0C) != 0 || dictionary != 0 || !states_size || content != size ||
      window > std::max(kFrameWindow, content) || content > kFrameExpansion * stored.size()) {
    return invalid_file("the zstd frame of a stream has an invalid header or another size");
  }
  return {};
}

Status unpack(View stored, std::span<std::uint8_t> out) {
  if (stored.size() == out.size()) {
    std::copy(stored.begin(), stored.end(), out.begin());
    return {};
  }
  const bool is_alone = ZSTD_findFrameCompressedSize(stored.data(), stored.size()) == stored.size();
  if (!is_alone ||
      ZSTD_decompress(out.data(), out.size(), stored.data(), stored.size()) != out.size()) {
    return invalid_file("the zstd frame of a stream is damaged");
  }
  return {};
}

}  // namespace stgs::stgs1
