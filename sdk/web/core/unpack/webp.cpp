// SPDX-License-Identifier: Apache-2.0
#include "unpack/webp.h"

#include <algorithm>
#include <array>
#include <optional>
#include <vector>

#include "unpack/bits.h"
#include "unpack/webp_transforms.h"

namespace stgs::web {
namespace {

constexpr int kLiterals = 256, kLengths = 24, kDistances = 40;  // symbols
constexpr std::array<std::uint8_t, 19> kOrder = {17, 18, 0, 1,  2,  3,  4,  5,  16, 6,
                                                 7,  8,  9, 10, 11, 12, 13, 14, 15};
constexpr std::size_t kNearby = 120;  // distance codes of pixels nearby

struct Offset {
  int x, y;  // to the left, up
};
// The pixels of distance codes 1 to 120 (RFC 9649, 5.2.2): by distance, then by |x|, those to the
// left first.
constexpr std::array<Offset, kNearby> nearby_pixels() {
  std::array<Offset, kNearby> out{};
  std::size_t count = 0;
  for (int square = 1; count < kNearby; ++square) {
    for (int x = 0; x <= 8; ++x) {
      for (int y = 0; y <= 7; ++y) {
        if (x * x + y * y != square) continue;
        out[count++] = {x, y};
        if (x > 0 && x < 8 && y > 0) out[count++] = {-x, y};
      }
    }
  }
  return out;
}
constexpr std::array<Offset, kNearby> kNearbyPixels = nearby_pixels();

// The codes of one region of the image.
struct Codes {
  PrefixCode green, red, blue, alpha, distance;
};

int read_symbol(const PrefixCode& code, BitReader& in) {
  return code.size() == 1 ? code.only_symbol() : code.read(in);
}

bool is_usable_code(const PrefixCode& code) {
  return code.size() == 1 || (code.size() > 0 && code.is_complete());
}

// RFC 9649, 6.2.1: codes of one or two symbols.
bool read_simple_code(BitReader& in, std::vector<std::uint8_t>& lengths) {
  const bool has_second = in.take(1) != 0;
  const std::uint32_t first = in.take(in.take(1) != 0 ? 8 : 1);
  const std::uint32_t second = has_second ? in.take(8) : first;
  if (first >= lengths.size() || second >= lengths.size()) return false;
  lengths[first] = lengths[second] = 1;
  return true;
}

// RFC 9649, 6.2.2: the lengths are coded themselves.
bool read_lengths(BitReader& in, std::vector<std::uint8_t>& lengths) {
  std::array<std::uint8_t, 19> order{};
  const std::size_t stored = 4 + in.take(4);
  for (std::size_t i = 0; i < stored; ++i) order[kOrder[i]] = static_cast<std::uint8_t>(in.take(3));
  PrefixCode code;
  if (!code.set(order) || !is_usable_code(code)) return false;
  std::size_t symbols = lengths.size();
  if (in.take(1) != 0) {
    symbols = 2 + in.take(2 + 2 * static_cast<int>(in.take(3)));
    if (symbols > lengths.size()) return false;
  }
  std::uint8_t last = 8;  // length that is not 0
  for (std::size_t at = 0; at < lengths.size() && symbols > 0; --symbols) {
    const int symbol = read_symbol(code, in);
    if (symbol < 0 || !in.ok()) return false;
    if (symbol < 16) {
      lengths[at++] = static_cast<std::uint8_t>(symbol);
      if (symbol != 0) last = static_cast<std::uint8_t>(symbol);
      continue;
    }
    const std::size_t repeat = symbol == 16   ? 3 + in.take(2)
                               : symbol == 17 ? 3 + in.take(3)
                                              : 11 + in.take(7);
    if (repeat > lengths.size() - at) return false;
    std::fill_n(lengths.begin() + static_cast<std::ptrdiff_t>(at), repeat,
                symbol == 16 ? last : std::uint8_t{0});
    at += repeat;
  }
  return true;
}

bool read_code(BitReader& in, int symbols, PrefixCode& code) {
  std::vector<std::uint8_t> lengths(static_cast<std::size_t>(symbols));
  const bool is_simple = in.take(1) != 0;
  if (!(is_simple ? read_simple_code(in, lengths) : read_lengths(in, lengths))) return false;
  return code.set(lengths) && is_usable_code(code) && in.ok();
}

bool read_codes(BitReader& in, int cache_bits, Codes& codes) {
  const int cache = cache_bits > 0 ? 1 << cache_bits : 0;
  return read_code(in, kLiterals + kLengths + cache, codes.green) &&
         read_code(in, kLiterals, codes.red) && read_code(in, kLiterals, codes.blue) &&
         read_code(in, kLiterals, codes.alpha) && read_code(in, kDistances, codes.distance);
}

// RFC 9649, 5.2.2: lengths and distances.
std::size_t prefixed(std::uint32_t symbol, BitReader& in) {
  if (symbol < 4) return symbol + 1;
  const int extra = static_cast<int>(symbol - 2) / 2;
  return ((2 + std::size_t{symbol} % 2) << extra) + in.take(extra) + 1;
}

std::size_t pixel_distance(std::size_t code, std::uint32_t width) {
  if (code > kNearby) return code - kNearby;
  const Offset offset = kNearbyPixels[code - 1];
  const std::int64_t distance = offset.x + std::int64_t{offset.y} * width;
  return distance < 1 ? 1 : static_cast<std::size_t>(distance);
}

// An image that holds a value per block of another one.
struct Blocks {
  int bits = 0;  // log2 of the side of a block
  std::uint32_t width = 0;
  std::vector<std::uint32_t> values;

  std::size_t index(std::uint32_t x, std::uint32_t y) const {
    return std::size_t{y >> bits} * width + (x >> bits);
  }
};

class ImageDecoder {
 public:
  explicit ImageDecoder(BitReader& in) : in_(in) {}

  // Decodes an image (5.2). `is_main`: it may have several sets of codes.
  bool decode(std::uint32_t width, std::uint32_t height, bool is_main,
              std::vector<std::uint32_t>& out);

 private:
  bool read_regions(std::uint32_t width, std::uint32_t height, bool is_main);
  bool read_pixels(std::uint32_t width, std::vector<std::uint32_t>& out);
  std::uint32_t& cached(std::uint32_t pixel) {
    return cache_[(0x1E35A7BDu * pixel) >> (32 - cache_bits_)];
  }
  const Codes& codes_at(std::size_t at, std::uint32_t width) const {
    if (regions_.values.empty()) return codes_[0];
    const auto x = static_cast<std::uint32_t>(at % width),
               y = static_cast<std::uint32_t>(at / width);
    return codes_[regions_.values[regions_.index(x, y)]];
  }

  BitReader& in_;
  int cache_bits_ = 0;
  std::vector<std::uint32_t> cache_;
  Blocks regions_;  // index of the codes; no values: one set of codes
  std::vector<Codes> codes_;
};

// Reads the image of blocks of another image.
bool read_blocks(BitReader& in, std::uint32_t width, std::uint32_t height, Blocks& out) {
  out.bits = 2 + static_cast<int>(in.take(3));
  out.width = blocks_of(width, out.bits);
  return ImageDecoder(in).decode(out.width, blocks_of(height, out.bits), false, out.values);
}

// Reads the codes of all regions (6.2.3); keeps those that a region uses.
bool ImageDecoder::read_regions(std::uint32_t width, std::uint32_t height, bool is_main) {
  std::vector<std::int32_t> kept(1, 0);  // by number of the file: index in codes_, or -1
  if (is_main && in_.take(1) != 0) {
    if (!read_blocks(in_, width, height, regions_)) return false;
    std::uint32_t most = 0;
    for (std::uint32_t& value : regions_.values) most = std::max(most, value = value >> 8 & 0xFFFF);
    kept.assign(most + 1, -1);
    std::int32_t count = 0;
    for (std::uint32_t& value : regions_.values) {
      if (kept[value] < 0) kept[value] = count++;
      value = static_cast<std::uint32_t>(kept[value]);
    }
  }
  std::size_t used = 0;
  for (const std::int32_t index : kept) used += index >= 0 ? 1 : 0;
  codes_.resize(1);
  Codes unused;
  for (const std::int32_t index : kept) {
    const auto at = static_cast<std::size_t>(std::max(index, 0));
    // Grows with what the file holds.
    if (index >= 0 && at >= codes_.size()) codes_.resize(std::min(used, std::max(at + 1, 2 * at)));
    if (!read_codes(in_, cache_bits_, index >= 0 ? codes_[at] : unused)) return false;
  }
  return true;
}

bool ImageDecoder::read_pixels(std::uint32_t width, std::vector<std::uint32_t>& out) {
  const auto remember = [&](std::uint32_t pixel) {
    if (cache_bits_ > 0) cached(pixel) = pixel;
  };
  for (std::size_t at = 0; at < out.size();) {
    const Codes& codes = codes_at(at, width);
    const int symbol = read_symbol(codes.green, in_);
    if (symbol < 0 || !in_.ok()) return false;
    const auto code = static_cast<std::uint32_t>(symbol);
    if (code < kLiterals) {
      const int red = read_symbol(codes.red, in_), blue = read_symbol(codes.blue, in_);
      const int alpha = read_symbol(codes.alpha, in_);
      if (red < 0 || blue < 0 || alpha < 0) return false;
      out[at] = static_cast<std::uint32_t>(alpha) << 24 | static_cast<std::uint32_t>(red) << 16 |
                code << 8 | static_cast<std::uint32_t>(blue);
      remember(out[at++]);
    } else if (code < kLiterals + kLengths) {
      const std::size_t length = prefixed(code - kLiterals, in_);
      const int distance_symbol = read_symbol(codes.distance, in_);
      if (distance_symbol < 0) return false;
      const std::size_t distance =
          pixel_distance(prefixed(static_cast<std::uint32_t>(distance_symbol), in_), width);
      if (distance > at || length > out.size() - at) return false;
      for (const std::size_t end = at + length; at < end; ++at) {
        out[at] = out[at - distance];
        remember(out[at]);
      }
    } else {
      out[at] = cache_[code - kLiterals - kLengths];
      remember(out[at++]);
    }
  }
  return in_.ok();
}

bool ImageDecoder::decode(std::uint32_t width, std::uint32_t height, bool is_main,
                          std::vector<std::uint32_t>& out) {
  if (in_.take(1) != 0) {
    cache_bits_ = static_cast<int>(in_.take(4));
    if (cache_bits_ < 1 || cache_bits_ > 11) return false;
    cache_.assign(std::size_t{1} << cache_bits_, 0);
  }
  if (!read_regions(width, height, is_main)) return false;
  out.resize(std::size_t{width} * height);
  return read_pixels(width, out);
}

enum Kind { kPredictor, kCrossColour, kSubtractGreen, kPalette };

struct Transform {
  Kind kind = kPredictor;
  Blocks blocks;            // of kPredictor and kCrossColour; `values` is the palette of kPalette
  std::uint32_t width = 0;  // of the image that the transform returns
};

// Reads a transform of an image, whose width it may change (4).
bool read_transform(BitReader& in, std::uint32_t& width, std::uint32_t height, Transform& out) {
  out.width = width;
  if (out.kind == kSubtractGreen) return true;
  if (out.kind != kPalette) return read_blocks(in, width, height, out.blocks);
  const std::uint32_t size = 1 + in.take(8);
  out.blocks.bits = size > 16 ? 0 : size > 4 ? 1 : size > 2 ? 2 : 3;
  width = blocks_of(width, out.blocks.bits);
  if (!ImageDecoder(in).decode(size, 1, false, out.blocks.values)) return false;
  std::vector<std::uint32_t>& palette = out.blocks.values;
  for (std::size_t i = 1; i < palette.size(); ++i)
    palette[i] = add_channels(palette[i], palette[i - 1]);
  palette.resize(256);  // indices past the end are transparent black
  return true;
}

void undo(const Transform& transform, std::uint32_t height, std::vector<std::uint32_t>& pixels) {
  const auto block = [&](std::uint32_t x, std::uint32_t y) {
    return transform.blocks.values[transform.blocks.index(x, y)];
  };
  switch (transform.kind) {
    case kPredictor:
      return undo_prediction(pixels, transform.width, height, block);
    case kCrossColour:
      return undo_cross_colour(pixels, transform.width, height, block);
    case kSubtractGreen:
      return undo_subtract_green(pixels);
    case kPalette:
      return undo_palette(pixels, transform.width, height, transform.blocks.bits,
                          transform.blocks.values);
  }
}

}  // namespace

std::uint64_t vp8l_scratch(std::uint64_t width, std::uint64_t height, std::uint64_t bytes) {
  // The codes of a region have tables, and two bytes for each symbol; reading one takes three bytes
  // more. Codes take at least 20 bits of the stream, twice the memory while their list grows.
  constexpr std::uint64_t kCodes = sizeof(Codes) + 2 * (4 * 256 + 24 + 2048 + 40) + 5 * 16;
  const std::uint64_t blocks = (width + 3) / 4 * ((height + 3) / 4);
  const std::uint64_t sets = std::min({std::uint64_t{1} << 16, blocks, bytes * 8 / 20 + 1});
  constexpr std::uint64_t kFixed = 64 << 10;
  // Two copies of the pixels while a palette is applied; the images of three kinds of blocks.
  return 8 * width * height + 3 * 4 * blocks + 2 * sets * kCodes + (4 << 16) + kFixed;
}

bool decode_vp8l(std::span<const std::uint8_t> stream, std::uint32_t width, std::uint32_t height,
                 std::span<std::uint8_t> rgba) {
  BitReader in(stream);
  std::vector<Transform> transforms;
  std::uint32_t stored_width = width;
  while (in.take(1) != 0) {
    Transform transform;
    transform.kind = static_cast<Kind>(in.take(2));
    const auto is_same = [&](const Transform& other) { return other.kind == transform.kind; };
    if (std::any_of(transforms.begin(), transforms.end(), is_same)) return false;
    if (!read_transform(in, stored_width, height, transform)) return false;
    transforms.push_back(std::move(transform));
  }
  std::vector<std::uint32_t> pixels;
  if (!ImageDecoder(in).decode(stored_width, height, true, pixels)) return false;
  for (auto it = transforms.rbegin(); it != transforms.rend(); ++it) undo(*it, height, pixels);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const std::uint32_t pixel = pixels[i];
    rgba[4 * i] = static_cast<std::uint8_t>(pixel >> 16);
    rgba[4 * i + 1] = static_cast<std::uint8_t>(pixel >> 8);
    rgba[4 * i + 2] = static_cast<std::uint8_t>(pixel);
    rgba[4 * i + 3] = static_cast<std::uint8_t>(pixel >> 24);
  }
  return true;
}

}  // namespace stgs::web
