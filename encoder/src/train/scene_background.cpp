// SPDX-License-Identifier: Apache-2.0
#include "train/scene_background.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "stgs/format/raster.h"

namespace stgs::encoder {
namespace {

using Histogram = std::array<std::uint64_t, 256>;

float median(const Histogram& histogram) {
  std::uint64_t total = 0, below = 0;
  for (std::uint64_t count : histogram) total += count;
  for (std::size_t value = 0; value < histogram.size(); ++value) {
    below += histogram[value];
    if (2 * below > total) return static_cast<float>(value) / 255.0f;
  }
  return 0.0f;
}

bool is_border(std::size_t pixel, const Camera& camera) {
  const auto width = static_cast<std::size_t>(camera.width);
  const int x = static_cast<int>(pixel % width), y = static_cast<int>(pixel / width);
  const int band = std::max(1, std::min(camera.width, camera.height) / 16);
  return std::min({x, y, camera.width - 1 - x, camera.height - 1 - y}) < band;
}

}  // namespace

Result<math::Vec3> scene_background(const PreparedCapture& capture, const Gaussians4D& initial,
                                    int kernel, bool border_only) {
  std::array<Histogram, 3> histograms{};
  SplatFrame frame;
  RasterOutput output;
  RasterSettings settings;
  settings.kernel = kernel;
  const int middle = capture.frames / 2;
  for (const Camera& camera : capture.cameras) {
    if (camera.test || !has_frame(capture, camera, middle)) continue;
    STGS_ASSIGN(const Image8 image, load_frame(capture, camera, middle));
    render(initial, static_cast<float>(middle), camera.pinhole(capture.near_plane), settings, frame,
           output);
    for (std::size_t p = 0; p < output.transmittance.data.size(); ++p) {
      if (border_only && !is_border(p, camera)) continue;
      const auto weight =
          static_cast<std::uint64_t>(std::lround(255.0f * output.transmittance.data[p]));
      for (std::size_t c = 0; c < 3; ++c) histograms[c][image.data[3 * p + c]] += weight;
    }
  }
  return math::Vec3{median(histograms[0]), median(histograms[1]), median(histograms[2])};
}

}  // namespace stgs::encoder
