// SPDX-License-Identifier: Apache-2.0
// The pixels of converted, undistorted and scaled frames, for the CPU and CUDA. Conversion equals
// that of FFmpeg's swscale (bicubic chroma, accurate rounding), and undistortion OpenCV's remap()
// (cubic), whose integer arithmetic this follows. Scaling differs from OpenCV's resize()
// (INTER_AREA) by at most 1, because sums of floats depend on the compiler.
#pragma once

#include <cstddef>
#include <cstdint>

#include "stgs/format/math/lang.h"

namespace stgs::encoder::geometry {

// The chroma samples of a column or a row of pixels: four, from `first` on. The weights add up to
// 2^14 for columns and 2^12 for rows.
struct ChromaTaps {
  int first;
  int weight[4];
};

// The conversion to RGB, in the units of swscale.
struct YuvCoefficients {
  int y_offset, y_factor, v_to_r, v_to_g, u_to_g, u_to_b;
  bool operator==(const YuvCoefficients&) const = default;
};

// The planes of a 4:2:0 image of even width and height.
struct YuvPlanes {
  const void *luma, *u, *v;                // of the host or of the device
  std::size_t luma_stride, chroma_stride;  // bytes between rows
  int chroma_step;                         // samples between those of a plane; 2: u and v alternate
  int width, height;                       // pixels
  int bits;                                // of a sample: 8, or more in two bytes
  int shift;                               // unused bits below a sample
};

struct Bgr {
  std::uint8_t b, g, r;
};

// Where a pixel of an undistorted image comes from: the sample at or before it, and the index of
// the weights of the 4x4 samples around, by its position between samples in steps of 1/32.
struct WarpPosition {
  std::int16_t x, y;
  int weights;  // 32 * vertical step + horizontal step
};
inline constexpr int kWarpSteps = 32;
inline constexpr int kWarpTaps = 16;        // weights of a position, row by row
inline constexpr int kWarpWeightBits = 15;  // they add up to 2^15

// The samples that a scaled pixel covers along an axis, and their weights, which add up to 1.
struct AreaSpan {
  int first, count;
  float first_weight, weight, last_weight;  // `weight`: of those between
};

// An image of 3 or 4 bytes per pixel, of the host or of the device. The fourth is not used.
struct PackedImage {
  const std::uint8_t* data;
  int width, height;   // pixels
  std::size_t stride;  // bytes between rows
  int channels;
};

STGS_FN int clamped_to(int value, int low, int high) {
  return value < low ? low : value > high ? high : value;
}

STGS_FN int yuv_sample(const YuvPlanes& image, const void* plane, std::size_t row, int column) {
  const auto* bytes = static_cast<const std::uint8_t*>(plane) + row;
  if (image.bits == 8) return bytes[column];
  return reinterpret_cast<const std::uint16_t*>(bytes)[column] >> image.shift;
}

// Returns the chroma at a pixel, times 512; 0 is neutral.
STGS_FN int chroma_at(const YuvPlanes& image, const void* plane, const ChromaTaps& column,
                      const ChromaTaps& row) {
  int sum = (1 << 9) - (128 << 19);
  for (int j = 0; j < 4; ++j) {
    const int y = clamped_to(row.first + j, 0, image.height / 2 - 1);
    int across = 0;
    for (int i = 0; i < 4; ++i) {
      const int x = clamped_to(column.first + i, 0, image.width / 2 - 1);
      across += column.weight[i] *
                yuv_sample(image, plane, y * image.chroma_stride, x * image.chroma_step);
    }
    across >>= image.bits - 1;
    sum += row.weight[j] * (across < 32767 ? across : 32767);
  }
  return sum >> 10;
}

STGS_FN std::uint8_t colour_byte(int value) {
  return static_cast<std::uint8_t>(clamped_to(value, 0, (1 << 30) - 1) >> 22);
}

// Returns a pixel. `columns`, `rows`: its taps.
STGS_FN Bgr yuv_pixel(const YuvPlanes& image, const YuvCoefficients& c, const ChromaTaps& column,
                      const ChromaTaps& row, int x, int y) {
  const int u = chroma_at(image, image.u, column, row), v = chroma_at(image, image.v, column, row);
  const int luma = yuv_sample(image, image.luma, y * image.luma_stride, x) << (17 - image.bits);
  // Sums of extreme colours wrap around, as in swscale.
  const auto product = [](int a, int b) { return unsigned(a) * unsigned(b); };
  const unsigned grey = product(luma - c.y_offset, c.y_factor) + (1u << 21);
  Bgr out;
  out.b = colour_byte(int(grey + product(u, c.u_to_b)));
  out.g = colour_byte(int(grey + product(v, c.v_to_g) + product(u, c.u_to_g)));
  out.r = colour_byte(int(grey + product(v, c.v_to_r)));
  return out;
}

// Returns where pixel (x, y) of a width x height image is after a clockwise rotation by `quarters`
// quarters of a turn, as an index.
STGS_FN std::size_t rotated_index(int quarters, int width, int height, int x, int y) {
  const std::size_t w = static_cast<std::size_t>(width), h = static_cast<std::size_t>(height);
  if (quarters == 1) return x * h + (height - 1 - y);
  if (quarters == 2) return (height - 1 - y) * w + (width - 1 - x);
  if (quarters == 3) return (width - 1 - x) * h + y;
  return y * w + x;
}

// Returns channel `c` of an undistorted pixel; the edge of the image is repeated.
STGS_FN std::uint8_t warped_sample(const PackedImage& image, WarpPosition at,
                                   const std::int16_t* weights, int c) {
  int sum = 1 << (kWarpWeightBits - 1);
  for (int j = 0; j < 4; ++j) {
    const int y = clamped_to(at.y - 1 + j, 0, image.height - 1);
    for (int i = 0; i < 4; ++i) {
      const int x = clamped_to(at.x - 1 + i, 0, image.width - 1);
      sum += weights[kWarpTaps * at.weights + 4 * j + i] *
             image.data[y * image.stride + x * image.channels + c];
    }
  }
  return static_cast<std::uint8_t>(clamped_to(sum >> kWarpWeightBits, 0, 255));
}

STGS_FN float span_weight(const AreaSpan& span, int k) {
  return k == 0 ? span.first_weight : k == span.count - 1 ? span.last_weight : span.weight;
}

// Returns channel `c` of the scaled pixel that covers these columns and rows.
STGS_FN std::uint8_t area_sample(const PackedImage& image, const AreaSpan& columns,
                                 const AreaSpan& rows, int c) {
  float sum = 0.0f;
  for (int j = 0; j < rows.count; ++j) {
    const std::uint8_t* const row = image.data + (rows.first + j) * image.stride + c;
    float across = 0.0f;
    for (int i = 0; i < columns.count; ++i)
      across += span_weight(columns, i) * row[(columns.first + i) * image.channels];
    sum += span_weight(rows, j) * across;
  }
  return static_cast<std::uint8_t>(clamped_to(static_cast<int>(sum + 0.5f), 0, 255));
}

}  // namespace stgs::encoder::geometry
