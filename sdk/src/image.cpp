// SPDX-License-Identifier: Apache-2.0
#include "image.h"

#include <algorithm>
#include <cstring>

#include "structs.h"

namespace stgs::sdk {
namespace {

constexpr std::size_t kPixelBytes = 4;  // of RGBA8 and of a float

Outcome check_buffer(const stgs_buffer& buffer, const char* name, std::size_t alignment,
                     std::uint32_t width, std::uint32_t height) {
  if (buffer.data == nullptr) return {};
  const std::size_t row = kPixelBytes * width;
  const std::size_t stride = buffer.stride == 0 ? row : buffer.stride;
  if (stride < row || stride % alignment != 0) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("{}: stride is {} bytes (expected a multiple of {}, at least {} for {} "
                        "pixels)",
                        name, stride, alignment, row, width)};
  }
  if (reinterpret_cast<std::uintptr_t>(buffer.data) % alignment != 0) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("{}: data is not aligned to {} bytes", name, alignment)};
  }
  // Division avoids overflow: all rows except the last take stride bytes.
  if (buffer.bytes < row || (height > 1 && (buffer.bytes - row) / (height - 1) < stride)) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("{}: the buffer of {} bytes is too small for {}x{} pixels with a stride of "
                        "{} bytes",
                        name, buffer.bytes, width, height, stride)};
  }
  return {};
}

std::uint8_t* row_of(const stgs_buffer& buffer, int width, int y) {
  const std::size_t stride = buffer.stride == 0 ? kPixelBytes * width : buffer.stride;
  return static_cast<std::uint8_t*>(buffer.data) + stride * y;
}

void write_plane(const Image& image, int channel, const stgs_buffer& buffer) {
  if (buffer.data == nullptr) return;
  for (int y = 0; y < image.height; ++y) {
    std::memcpy(row_of(buffer, image.width, y),
                image.plane(channel) + static_cast<std::size_t>(y) * image.width,
                sizeof(float) * image.width);
  }
}

// Rounds like `stgs render`.
std::uint8_t to_byte(float value) {
  return static_cast<std::uint8_t>(std::clamp(value, 0.0f, 1.0f) * 255.0f + 0.5f);
}

void write_rgba8(const player::Frame& frame, const stgs_buffer& buffer) {
  if (buffer.data == nullptr) return;
  const Image& colour = frame.colour;
  for (int y = 0; y < colour.height; ++y) {
    std::uint8_t* out = row_of(buffer, colour.width, y);
    const std::size_t begin = static_cast<std::size_t>(y) * colour.width;
    for (std::size_t i = begin; i < begin + colour.width; ++i, out += kPixelBytes) {
      for (int c = 0; c < 3; ++c) out[c] = to_byte(colour.plane(c)[i]);
      out[3] = to_byte(frame.alpha.plane(0)[i]);
    }
  }
}

}  // namespace

Outcome check_image(const stgs_image& image, std::uint32_t width, std::uint32_t height) {
  STGS_SDK_TRY(check_buffer(image.rgba8, "rgba8", 1, width, height));
  int planes = 0;
  for (const stgs_buffer& plane : image.rgb) {
    STGS_SDK_TRY(check_buffer(plane, "rgb", sizeof(float), width, height));
    planes += plane.data != nullptr ? 1 : 0;
  }
  STGS_SDK_TRY(check_buffer(image.alpha, "alpha", sizeof(float), width, height));
  STGS_SDK_TRY(check_buffer(image.depth, "depth", sizeof(float), width, height));
  if (planes != 0 && planes != 3) {
    return {STGS_ERROR_ARGUMENT, "rgb: only some planes are set; set all three planes or none"};
  }
  if (planes == 0 && image.rgba8.data == nullptr && image.alpha.data == nullptr &&
      image.depth.data == nullptr) {
    return {STGS_ERROR_ARGUMENT, "the image has no buffer; set at least one"};
  }
  return {};
}

void write_image(const player::Frame& frame, const stgs_image& image) {
  write_rgba8(frame, image.rgba8);
  for (int c = 0; c < 3; ++c) write_plane(frame.colour, c, image.rgb[c]);
  write_plane(frame.alpha, 0, image.alpha);
  write_plane(frame.depth, 0, image.depth);
}

}  // namespace stgs::sdk

extern "C" stgs_result stgs_image_defaults(stgs_image* image, size_t struct_size) {
  return stgs::sdk::fill_defaults(image, struct_size, stgs_image{});
}
