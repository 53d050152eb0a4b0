// SPDX-License-Identifier: Apache-2.0
#include "image_io.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "exr.h"
#include "options.h"
#include "png.h"
#include "stgs/encoder/image_file.h"
#include "stgs/encoder/metrics.h"
#include "stgs/format/output_file.h"
#include "stgs/format/output_path.h"

namespace stgs::tools {
namespace {

// Samples one channel at a point in pixels: bilinear, edges clamped.
float sample(const encoder::Image8& image, float x, float y, int channel) {
  const auto at = [&](int i, int j) {
    i = std::clamp(i, 0, image.width - 1);
    j = std::clamp(j, 0, image.height - 1);
    return static_cast<float>(
        image.data[(static_cast<std::size_t>(j) * image.width + i) * 3 + channel]);
  };
  const int i = static_cast<int>(std::floor(x - 0.5f)), j = static_cast<int>(std::floor(y - 0.5f));
  const float u = x - 0.5f - static_cast<float>(i), v = y - 0.5f - static_cast<float>(j);
  return (1 - v) * ((1 - u) * at(i, j) + u * at(i + 1, j)) +
         v * ((1 - u) * at(i, j + 1) + u * at(i + 1, j + 1));
}

// Memory per pixel of two images side by side: the scaled right one, the result, and its PNG file
// while it grows, bytes.
constexpr std::uint64_t kSideBySideBytes = 18;

// Returns the width of an image scaled to a height, pixels.
std::int64_t width_at(const encoder::Image8& image, int height) {
  const double scale = static_cast<double>(image.height) / height;
  return std::max<std::int64_t>(1, std::llround(image.width / scale));
}

// The width at this height fits into an int.
encoder::Image8 scaled_to_height(const encoder::Image8& image, int height) {
  encoder::Image8 out;
  out.height = height;
  const float scale = static_cast<float>(image.height) / static_cast<float>(height);
  out.width = static_cast<int>(width_at(image, height));
  out.channels = 3;
  out.data.resize(static_cast<std::size_t>(out.width) * height * 3);
  std::size_t at = 0;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        const float v = sample(image, (static_cast<float>(x) + 0.5f) * scale,
                               (static_cast<float>(y) + 0.5f) * scale, c);
        out.data[at++] = static_cast<std::uint8_t>(v + 0.5f);
      }
    }
  }
  return out;
}

}  // namespace

encoder::Image8 to_8bit(const Image& colour) {
  encoder::Image8 out;
  out.width = colour.width;
  out.height = colour.height;
  out.channels = 3;
  const std::size_t pixels = static_cast<std::size_t>(colour.width) * colour.height;
  out.data.resize(pixels * 3);
  for (int c = 0; c < 3; ++c) {
    const float* plane = colour.plane(c);
    for (std::size_t i = 0; i < pixels; ++i) {
      const float v = std::clamp(plane[i], 0.0f, 1.0f);
      out.data[i * 3 + c] = static_cast<std::uint8_t>(v * 255.0f + 0.5f);
    }
  }
  return out;
}

Result<encoder::Image8> side_by_side(const encoder::Image8& left, const encoder::Image8& right,
                                     const std::string& name, std::uint64_t max_memory) {
  const std::int64_t width = left.width + width_at(right, left.height);
  const std::int64_t pixels = width * left.height;
  if (pixels > encoder::kMaxImagePixels) {
    return unsupported(
        "{}: a captured frame of {}x{} pixels beside the render gives an image of {}x{} (at most "
        "{} pixels); leave out --side-by-side",
        name, right.width, right.height, width, left.height, encoder::kMaxImagePixels);
  }
  const std::uint64_t bytes = kSideBySideBytes * static_cast<std::uint64_t>(pixels);
  if (bytes > max_memory) {
    return Status(
        StatusCode::kLimit,
        fmt::format("{}: an image of {}x{} pixels with the captured frame needs {} bytes, "
                    "more than the limit of {}; reduce it with --size, or allow more "
                    "memory",
                    name, width, left.height, bytes, max_memory));
  }
  const encoder::Image8 fitted =
      right.height == left.height ? right : scaled_to_height(right, left.height);
  encoder::Image8 out;
  out.width = static_cast<int>(width);
  out.height = left.height;
  out.channels = 3;
  out.data.reserve(static_cast<std::size_t>(pixels) * 3);
  for (int y = 0; y < out.height; ++y) {
    for (const encoder::Image8* side : {&left, &fitted}) {
      const auto row = side->data.begin() + static_cast<std::ptrdiff_t>(y) * side->width * 3;
      out.data.insert(out.data.end(), row, row + static_cast<std::ptrdiff_t>(side->width) * 3);
    }
  }
  return out;
}

Status write_png(const std::string& path, const encoder::Image8& image) {
  STGS_TRY(check_can_write(path));
  return write_file_atomically(path, encode_png(image));
}

Status write_single_png(const std::string& path, const encoder::Image8& image,
                        const encoder::LogSink& log) {
  clear_leftovers(path, log);
  return write_png(path, image);
}

Status write_exr(const std::string& path, const FloatFrame& frame) {
  STGS_TRY(check_can_write(path));
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, encode_exr(frame, path));
  return write_file_atomically(path, bytes);
}

Result<Image> read_image(const std::string& path, std::uint64_t max_memory) {
  if (extension_of(path) == ".exr") return read_exr_file(path, max_memory);
  STGS_ASSIGN(const encoder::Image8 image, encoder::read_image8(path, 3, max_memory));
  const std::uint64_t pixels =
      std::uint64_t{1} * static_cast<unsigned>(image.width) * static_cast<unsigned>(image.height);
  if (pixels * (3 + 3 * sizeof(float)) > max_memory) {
    return unsupported("{}: {}x{} pixels exceed the limit of {} bytes; allow more memory", path,
                       image.width, image.height, max_memory);
  }
  return encoder::to_float(image);
}

bool is_image_name(const std::string& path) {
  const std::string end = extension_of(path);
  return end == ".png" || end == ".jpg" || end == ".jpeg" || end == ".exr";
}

std::string extension_of(const std::string& path) {
  std::string end = std::filesystem::path(path).extension().string();
  std::transform(end.begin(), end.end(), end.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return end;
}

}  // namespace stgs::tools
