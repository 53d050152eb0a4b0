// SPDX-License-Identifier: Apache-2.0
#include "unpack/webp_transforms.h"

#include <algorithm>
#include <cstdlib>

namespace stgs::web {
namespace {

constexpr std::uint32_t kBlack = 0xFF000000u;

// Applies a function of 0 to 255 to each channel.
template <typename Function, typename... Pixels>
std::uint32_t per_channel(const Function& function, Pixels... pixels) {
  std::uint32_t out = 0;
  for (int shift = 0; shift < 32; shift += 8) {
    const int value = function(static_cast<int>(pixels >> shift & 0xFFu)...);
    out |= static_cast<std::uint32_t>(std::clamp(value, 0, 255)) << shift;
  }
  return out;
}

std::uint32_t average(std::uint32_t a, std::uint32_t b) {
  return (a & b) + (((a ^ b) >> 1) & 0x7F7F7F7Fu);
}

int difference(std::uint32_t a, std::uint32_t b) {
  int sum = 0;
  for (int shift = 0; shift < 32; shift += 8) {
    sum += std::abs(static_cast<int>(a >> shift & 0xFFu) - static_cast<int>(b >> shift & 0xFFu));
  }
  return sum;
}

// Predicts from the pixels to the left (l), above (t), and above to the left and right (tl, tr).
std::uint32_t predict(std::uint32_t mode, std::uint32_t l, std::uint32_t t, std::uint32_t tl,
                      std::uint32_t tr) {
  switch (mode) {
    case 1:
      return l;
    case 2:
      return t;
    case 3:
      return tr;
    case 4:
      return tl;
    case 5:
      return average(average(l, tr), t);
    case 6:
      return average(l, tl);
    case 7:
      return average(l, t);
    case 8:
      return average(tl, t);
    case 9:
      return average(t, tr);
    case 10:
      return average(average(l, tl), average(t, tr));
    case 11:
      return difference(t, tl) < difference(l, tl) ? l : t;
    case 12:
      return per_channel([](int a, int b, int c) { return a + b - c; }, l, t, tl);
    case 13:
      return per_channel([](int a, int b) { return a + (a - b) / 2; }, average(l, t), tl);
    default:
      return kBlack;  // 0; 14 and 15 have no meaning
  }
}

int signed_product(std::uint32_t a, std::uint32_t b) {
  return static_cast<std::int8_t>(a & 0xFFu) * static_cast<std::int8_t>(b & 0xFFu) >> 5;
}

}  // namespace

void undo_prediction(std::vector<std::uint32_t>& pixels, std::uint32_t width, std::uint32_t height,
                     const BlockValue& block) {
  std::size_t at = 0;
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x, ++at) {
      std::uint32_t predicted = kBlack;
      if (y == 0) {
        if (x > 0) predicted = pixels[at - 1];
      } else if (x == 0) {
        predicted = pixels[at - width];
      } else {
        // The pixel above to the right of the last one of a row is the first one of this row.
        predicted = predict(block(x, y) >> 8 & 15, pixels[at - 1], pixels[at - width],
                            pixels[at - width - 1], pixels[at - width + 1]);
      }
      pixels[at] = add_channels(pixels[at], predicted);
    }
  }
}

void undo_cross_colour(std::vector<std::uint32_t>& pixels, std::uint32_t width,
                       std::uint32_t height, const BlockValue& block) {
  std::size_t at = 0;
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x, ++at) {
      const std::uint32_t factors = block(x, y), pixel = pixels[at], green = pixel >> 8;
      const std::uint32_t red =
          (pixel >> 16) + static_cast<std::uint32_t>(signed_product(factors, green));
      const std::uint32_t blue =
          pixel + static_cast<std::uint32_t>(signed_product(factors >> 8, green) +
                                             signed_product(factors >> 16, red));
      pixels[at] = (pixel & 0xFF00FF00u) | (red & 0xFFu) << 16 | (blue & 0xFFu);
    }
  }
}

void undo_subtract_green(std::vector<std::uint32_t>& pixels) {
  for (std::uint32_t& pixel : pixels) {
    const std::uint32_t green = pixel >> 8 & 0xFFu;
    pixel = add_channels(pixel, green << 16 | green);
  }
}

void undo_palette(std::vector<std::uint32_t>& pixels, std::uint32_t width, std::uint32_t height,
                  int bits, std::span<const std::uint32_t> palette) {
  std::vector<std::uint32_t> out(std::size_t{width} * height);
  const std::uint32_t stored_width = blocks_of(width, bits), index_bits = 8u >> bits;
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x) {
      const std::uint32_t indices =
          pixels[std::size_t{y} * stored_width + (x >> bits)] >> 8 & 0xFFu;
      const std::uint32_t shift = (x & ((1u << bits) - 1)) * index_bits;
      out[std::size_t{y} * width + x] = palette[indices >> shift & ((1u << index_bits) - 1)];
    }
  }
  pixels = std::move(out);
}

}  // namespace stgs::web
