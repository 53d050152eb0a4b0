// SPDX-License-Identifier: Apache-2.0
#include "webp_stream.h"

#include <algorithm>

#include "core/bytes.h"

namespace stgs::web {
namespace {

using View = std::span<const std::uint8_t>;

constexpr std::uint32_t tag(const char (&name)[5]) {
  return static_cast<std::uint32_t>(name[0]) | static_cast<std::uint32_t>(name[1]) << 8 |
         static_cast<std::uint32_t>(name[2]) << 16 | static_cast<std::uint32_t>(name[3]) << 24;
}

// Finds the stream of a file (RFC 9649, 2).
Result<View> find_stream(View bytes, const std::string& label) {
  ByteReader in(bytes);
  const auto truncated = [&] {
    return invalid_file("{}: truncated within the header ({} bytes)", label, bytes.size());
  };
  const std::uint32_t riff = in.u32();
  in.u32();  // size of the file
  const std::uint32_t webp = in.u32();
  if (!in.ok()) return truncated();
  if (riff != tag("RIFF") || webp != tag("WEBP")) {
    return invalid_file("{}: not a WebP image", label);
  }
  for (bool is_extended = false;;) {
    const std::uint32_t chunk = in.u32(), size = in.u32();
    if (!in.ok()) return truncated();
    if (chunk == tag("VP8L")) return in.bytes(std::min<std::uint64_t>(size, in.left()));
    if (chunk == tag("VP8 ")) {
      return invalid_file("{}: lossy WebP (expected lossless, because pixels are data)", label);
    }
    const View content = in.bytes(size + (size & 1u));
    if (!in.ok()) return truncated();
    constexpr int kAnimated = 2;
    if (chunk == tag("VP8X") && !content.empty()) {
      is_extended = true;
      if ((content[0] & kAnimated) != 0) {
        return invalid_file("{}: animated WebP (expected one image)", label);
      }
    }
    if (!is_extended) return invalid_file("{}: not a WebP image", label);
  }
}

}  // namespace

Result<WebpStream> lossless_webp_stream(View bytes, const std::string& label) {
  STGS_ASSIGN(const View stream, find_stream(bytes, label));
  ByteReader in(stream);
  const int magic = in.u8();
  const std::uint32_t fields = in.u32();  // width - 1, height - 1, use of alpha, version
  if (!in.ok()) {
    return invalid_file("{}: truncated within the header ({} bytes)", label, stream.size());
  }
  constexpr std::uint32_t kSide = (1 << 14) - 1;
  if (magic != 0x2F || fields >> 29 != 0) return invalid_file("{}: not a WebP image", label);
  const ImageSize size{static_cast<int>(fields & kSide) + 1,
                       static_cast<int>(fields >> 14 & kSide) + 1};
  return WebpStream{size, stream};
}

}  // namespace stgs::web
