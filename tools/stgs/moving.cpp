// SPDX-License-Identifier: Apache-2.0
#include "moving.h"
#include "stgs/format/parallel.h"

#include <algorithm>
#include <array>
#include <cstdlib>

namespace stgs::tools {

std::vector<std::size_t> median_frames(std::size_t count) {
  if (count < kMinMedianFrames) return {};
  const std::size_t odd = std::min(kMaxMedianFrames, count % 2 == 1 ? count : count - 1);
  std::vector<std::size_t> frames;
  for (std::size_t k = 0; k < odd; ++k) frames.push_back((2 * k + 1) * count / (2 * odd));
  return frames;
}

encoder::Image8 median_of(const std::vector<encoder::Image8>& images) {
  encoder::Image8 median = images.front();
  const std::size_t n = std::min(images.size(), kMaxMedianFrames);
  const std::size_t row = static_cast<std::size_t>(median.width) * median.channels;
  parallel_for(0, median.height, [&](int y) {
    std::array<std::uint8_t, kMaxMedianFrames> values{};
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(n / 2);
    for (std::size_t i = y * row; i < (y + 1) * row; ++i) {
      for (std::size_t k = 0; k < n; ++k) values[k] = images[k].data[i];
      std::nth_element(values.begin(), middle, values.begin() + static_cast<std::ptrdiff_t>(n));
      median.data[i] = *middle;
    }
  });
  return median;
}

Result<encoder::Image8> median_background(const encoder::PreparedCapture& capture,
                                          const encoder::Camera& camera,
                                          const std::vector<int>& frames) {
  const std::vector<std::size_t> chosen = median_frames(frames.size());
  if (chosen.empty()) return encoder::Image8{};
  std::vector<encoder::Image8> images(chosen.size());
  std::vector<Status> loading(chosen.size());
  parallel_for(std::size_t{0}, chosen.size(), [&](std::size_t k) {
    auto loaded = encoder::load_frame(capture, camera, frames[chosen[k]]);
    if (loaded.ok()) {
      images[k] = std::move(*loaded);
    } else {
      loading[k] = loaded.status();
    }
  });
  for (const Status& status : loading) STGS_TRY(status);
  return median_of(images);
}

ErrorSum& ErrorSum::operator+=(const ErrorSum& other) {
  squares += other.squares;
  pixels += other.pixels;
  return *this;
}

void ErrorSum::add(const Image& image, const encoder::Image8& ground_truth, std::size_t i) {
  ++pixels;
  for (int c = 0; c < 3; ++c) {
    const double d = static_cast<double>(image.plane(c)[i]) - ground_truth.data[3 * i + c] / 255.0;
    squares += d * d;
  }
}

bool is_moving(const std::uint8_t* pixel, const std::uint8_t* background) {
  int change = 0;
  for (int c = 0; c < 3; ++c) change = std::max(change, std::abs(pixel[c] - background[c]));
  return change > kMovingThreshold;
}

ErrorSum moving_error(const Image& image, const encoder::Image8& ground_truth,
                      const encoder::Image8& background) {
  ErrorSum sum;
  const std::size_t pixels = static_cast<std::size_t>(ground_truth.width) * ground_truth.height;
  for (std::size_t i = 0; i < pixels; ++i) {
    if (is_moving(&ground_truth.data[3 * i], &background.data[3 * i]))
      sum.add(image, ground_truth, i);
  }
  return sum;
}

}  // namespace stgs::tools
