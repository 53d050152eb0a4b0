// SPDX-License-Identifier: Apache-2.0
// Images of the importers (format/src/interchange/webp_image.h) without libwebp.
#include "core/bytes.h"
#include "interchange/webp_image.h"
#include "unpack/webp.h"

namespace stgs {
namespace {

using View = std::span<const std::uint8_t>;

constexpr std::size_t kStreamHeader = 5;  // of a lossless stream

constexpr std::uint32_t tag(const char (&name)[5]) {
  return static_cast<std::uint32_t>(name[0]) | static_cast<std::uint32_t>(name[1]) << 8 |
         static_cast<std::uint32_t>(name[2]) << 16 | static_cast<std::uint32_t>(name[3]) << 24;
}

// Returns the lossless stream of a file (RFC 9649, 2), with its header.
Result<View> lossless_stream(View bytes, const std::string& label) {
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

Result<ImageSize> stream_size(View stream, const std::string& label) {
  if (stream.size() < kStreamHeader) {
    return invalid_file("{}: truncated within the header ({} bytes)", label, stream.size());
  }
  const std::uint32_t fields = ByteReader(stream.subspan(1)).u32();
  constexpr std::uint32_t kMagic = 0x2F, kSide = (1 << 14) - 1;
  if (stream[0] != kMagic || fields >> 29 != 0) {
    return invalid_file("{}: not a WebP image", label);
  }
  return ImageSize{static_cast<int>(fields & kSide) + 1,
                   static_cast<int>(fields >> 14 & kSide) + 1};
}

}  // namespace

Result<ImageSize> lossless_webp_size(View bytes, const std::string& label) {
  STGS_ASSIGN(const View stream, lossless_stream(bytes, label));
  return stream_size(stream, label);
}

Result<ImageRgba> decode_lossless_webp(View bytes, const std::string& label, ImportMemory& memory) {
  STGS_ASSIGN(const View stream, lossless_stream(bytes, label));
  STGS_ASSIGN(const ImageSize size, stream_size(stream, label));
  ImageRgba image;
  image.width = size.width;
  image.height = size.height;
  const auto width = static_cast<std::uint32_t>(size.width);
  const auto height = static_cast<std::uint32_t>(size.height);
  const std::string what = fmt::format("the {} x {} pixels of {}", width, height, label);
  STGS_ASSIGN(image.lease, memory.take(size.bytes(), what));
  STGS_ASSIGN(const Lease scratch,
              memory.take(web::vp8l_scratch(width, height, stream.size()), what));
  image.pixels.resize(static_cast<std::size_t>(size.bytes()));
  if (!web::decode_vp8l(stream.subspan(kStreamHeader), width, height, image.pixels)) {
    return invalid_file("{}: image is damaged or truncated", label);
  }
  return image;
}

}  // namespace stgs
