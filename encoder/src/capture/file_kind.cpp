// SPDX-License-Identifier: Apache-2.0
#include "file_kind.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <string_view>

#include "stgs/encoder/image_file.h"

namespace stgs::encoder {
namespace {

using Bytes = std::span<const std::uint8_t>;

enum class Kind { kPng, kJpeg, kBmp, kTiff, kWebp, kNone };
constexpr std::array<std::string_view, 6> kNames = {"PNG",  "JPEG", "BMP",
                                                    "TIFF", "WebP", "unknown"};

struct Size {
  std::uint64_t width = 0, height = 0;  // 0: the header is truncated
};

bool has(Bytes bytes, std::size_t at, std::string_view text) {
  return bytes.size() >= at + text.size() &&
         std::equal(text.begin(), text.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                    [](char c, std::uint8_t b) { return static_cast<std::uint8_t>(c) == b; });
}

// Returns an unsigned number of `count` bytes; 0 past the end.
std::uint64_t number(Bytes bytes, std::size_t at, std::size_t count, bool big_endian) {
  std::uint64_t value = 0;
  if (at > bytes.size() || count > bytes.size() - at) return 0;
  for (std::size_t i = 0; i < count; ++i) {
    value = value << 8 | bytes[at + (big_endian ? i : count - 1 - i)];
  }
  return value;
}

Kind kind_of(Bytes bytes) {
  using std::string_view_literals::operator""sv;
  if (has(bytes, 0, "\x89PNG\r\n\x1a\n")) return Kind::kPng;
  if (has(bytes, 0, "\xff\xd8\xff")) return Kind::kJpeg;
  if (has(bytes, 0, "BM")) return Kind::kBmp;
  if (has(bytes, 0, "II*\0"sv) || has(bytes, 0, "MM\0*"sv)) return Kind::kTiff;
  if (has(bytes, 0, "RIFF") && has(bytes, 8, "WEBP")) return Kind::kWebp;
  return Kind::kNone;
}

Kind kind_of_extension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (extension == ".png") return Kind::kPng;
  if (extension == ".jpg" || extension == ".jpeg") return Kind::kJpeg;
  if (extension == ".bmp") return Kind::kBmp;
  if (extension == ".tif" || extension == ".tiff") return Kind::kTiff;
  if (extension == ".webp") return Kind::kWebp;
  return Kind::kNone;
}

Size jpeg_size(Bytes bytes) {
  std::size_t at = 2;
  while (at + 3 < bytes.size()) {
    if (bytes[at] != 0xff) return {};
    const std::uint8_t marker = bytes[at + 1];
    if (marker == 0xff) {  // fill byte
      ++at;
      continue;
    }
    if (marker == 0) return {};  // decoders search on, and may find another size
    if (is_jpeg_frame_header(marker))
      return {number(bytes, at + 7, 2, true), number(bytes, at + 5, 2, true)};
    const bool alone = marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8);
    at += 2 + (alone ? 0 : number(bytes, at + 2, 2, true));
  }
  return {};
}

Size bmp_size(Bytes bytes) {
  if (number(bytes, 14, 4, false) == 12) {
    return {number(bytes, 18, 2, false), number(bytes, 20, 2, false)};
  }
  const auto height = static_cast<std::int32_t>(number(bytes, 22, 4, false));  // < 0: top to bottom
  const std::int64_t rows = height;
  return {number(bytes, 18, 4, false), static_cast<std::uint64_t>(rows < 0 ? -rows : rows)};
}

constexpr std::uint64_t kTiffShort = 3, kTiffLong = 4;  // types of values

// Returns the value of an entry of a TIFF directory, a single SHORT or LONG. Other types, which
// decoders accept as well, are 0.
std::uint64_t tiff_value(Bytes bytes, std::uint64_t entry, bool big) {
  const std::uint64_t type = number(bytes, entry + 2, 2, big);
  if ((type != kTiffShort && type != kTiffLong) || number(bytes, entry + 4, 4, big) != 1) return 0;
  return number(bytes, entry + 8, type == kTiffShort ? 2 : 4, big);
}

// Returns whether the strips or tiles of a TIFF image have at most twice the bytes of the file.
// They may share bytes, which are copied for each. `entry` lists their sizes.
bool tiff_data_fits(Bytes bytes, std::uint64_t entry, bool big) {
  constexpr std::uint64_t kFreeBytes = 1 << 20;
  const std::uint64_t type = number(bytes, entry + 2, 2, big);
  const std::uint64_t count = number(bytes, entry + 4, 4, big), width = type == kTiffShort ? 2 : 4;
  if ((type != kTiffShort && type != kTiffLong) || count > bytes.size() / width) return false;
  const std::uint64_t at = count * width <= 4 ? entry + 8 : number(bytes, entry + 8, 4, big);
  std::uint64_t sum = 0;
  for (std::uint64_t i = 0; i < count; ++i) sum += number(bytes, at + width * i, width, big);
  return sum <= 2 * bytes.size() + kFreeBytes;
}

// Returns whether the tiles of an image, each of which is decoded as a whole, have at most twice
// its pixels and 2^24 more.
bool tiles_fit(const Size& size, const Size& tile) {
  constexpr double kFree = 1 << 24;
  const auto rounded = [](std::uint64_t side, std::uint64_t unit) {
    return std::ceil(static_cast<double>(side) / static_cast<double>(unit)) *
           static_cast<double>(unit);
  };
  const double pixels = static_cast<double>(size.width) * static_cast<double>(size.height);
  return tile.width != 0 && tile.height != 0 &&
         rounded(size.width, tile.width) * rounded(size.height, tile.height) <= 2 * pixels + kFree;
}

// The size in the first directory.
Size tiff_size(Bytes bytes) {
  constexpr std::uint64_t kWidth = 256, kHeight = 257, kTileWidth = 322, kTileHeight = 323,
                          kStripBytes = 279, kTileBytes = 325, kEntry = 12;
  const bool big = bytes[0] == 'M';
  const std::uint64_t directory = number(bytes, 4, 4, big);
  const std::uint64_t entries = number(bytes, directory, 2, big);
  Size size, tile = {1, 1};
  std::uint64_t last = 0;
  for (std::uint64_t i = 0; i < entries; ++i) {
    const std::uint64_t at = directory + 2 + i * kEntry;
    const std::uint64_t tag = number(bytes, at, 2, big);
    if (tag <= last) return {};  // tags ascend: decoders differ in which of two they use
    last = tag;
    if (tag == kWidth) size.width = tiff_value(bytes, at, big);
    if (tag == kHeight) size.height = tiff_value(bytes, at, big);
    if (tag == kTileWidth) tile.width = tiff_value(bytes, at, big);
    if (tag == kTileHeight) tile.height = tiff_value(bytes, at, big);
    if ((tag == kStripBytes || tag == kTileBytes) && !tiff_data_fits(bytes, at, big)) return {};
  }
  return tiles_fit(size, tile) ? size : Size();
}

Size webp_size(Bytes bytes) {
  if (has(bytes, 12, "VP8 ")) {
    return {number(bytes, 26, 2, false) & 0x3fff, number(bytes, 28, 2, false) & 0x3fff};
  }
  if (has(bytes, 12, "VP8L") && bytes.size() >= 25) {
    const std::uint64_t sides = number(bytes, 21, 4, false);
    return {(sides & 0x3fff) + 1, (sides >> 14 & 0x3fff) + 1};
  }
  if (has(bytes, 12, "VP8X") && bytes.size() >= 30) {
    return {number(bytes, 24, 3, false) + 1, number(bytes, 27, 3, false) + 1};
  }
  return {};
}

Size size_of(Kind kind, Bytes bytes) {
  switch (kind) {
    case Kind::kPng:
      return {number(bytes, 16, 4, true), number(bytes, 20, 4, true)};
    case Kind::kJpeg:
      return jpeg_size(bytes);
    case Kind::kBmp:
      return bmp_size(bytes);
    case Kind::kTiff:
      return tiff_size(bytes);
    case Kind::kWebp:
      return webp_size(bytes);
    case Kind::kNone:
      break;
  }
  return {};
}

}  // namespace

Status check_image_kind(std::span<const std::uint8_t> bytes, const std::string& path,
                        const std::string& what) {
  const Kind kind = kind_of(bytes), expected = kind_of_extension(path);
  const auto name = [](Kind k) { return kNames[static_cast<std::size_t>(k)]; };
  if (expected == Kind::kNone) {
    return invalid_file(
        "{}: {}: not an image by its extension (expected .png, .jpg, .jpeg, .bmp, .tif, .tiff or "
        ".webp)",
        path, what);
  }
  if (kind == Kind::kNone) {
    return invalid_file("{}: cannot decode {}: this is not a {} file", path, what, name(expected));
  }
  if (kind != expected) {
    return invalid_file("{}: {}: this is a {} image, but its extension is that of {}; rename it",
                        path, what, name(kind), name(expected));
  }
  const Size size = size_of(kind, bytes);
  if (size.width == 0 || size.height == 0) {
    return invalid_file(
        "{}: cannot decode {}: its header is truncated or damaged, or states more data than the "
        "file can hold; export the image again",
        path, what);
  }
  return check_image_size(static_cast<std::int64_t>(size.width),
                          static_cast<std::int64_t>(size.height), path + ": " + what);
}

bool begins_with_box(std::span<const std::uint8_t> begin) {
  constexpr std::array<std::string_view, 7> kBoxes = {"ftyp", "moov", "mdat", "wide",
                                                      "free", "skip", "pnot"};
  // A box of 16 MiB or more could begin with the text of a script. The first byte 0 ends it.
  return !begin.empty() && begin[0] == 0 &&
         std::any_of(kBoxes.begin(), kBoxes.end(),
                     [&](std::string_view box) { return has(begin, 4, box); });
}

bool begins_with_matroska(std::span<const std::uint8_t> begin) {
  constexpr std::size_t kHeader = 128;
  if (!has(begin, 0, "\x1a\x45\xdf\xa3")) return false;
  for (std::size_t at = 4; at < std::min(begin.size(), kHeader); ++at) {
    if (has(begin, at, "matroska") || has(begin, at, "webm")) return true;
  }
  return false;
}

Status check_video_kind(std::span<const std::uint8_t> begin, const std::string& path,
                        const std::string& what) {
  const bool avi = has(begin, 0, "RIFF") && has(begin, 8, "AVI ");
  if (avi || begins_with_box(begin) || begins_with_matroska(begin)) return {};
  return invalid_file(
      "{}: {}: not an MP4, MOV, Matroska, WebM or AVI video by its first bytes; copy it into one "
      "of these containers (ffmpeg -i INPUT -c copy OUTPUT.mkv)",
      path, what);
}

}  // namespace stgs::encoder
