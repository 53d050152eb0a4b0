// SPDX-License-Identifier: Apache-2.0
#include "flicker.h"

#include <cmath>
#include <utility>

#include "moving.h"

namespace stgs::tools {
namespace {

double rms(double squares, std::uint64_t pixels) {
  return 255.0 * std::sqrt(squares / (3.0 * static_cast<double>(pixels)));
}

}  // namespace

Flicker& Flicker::operator+=(const Flicker& other) {
  render += other.render;
  ground_truth += other.ground_truth;
  pixels += other.pixels;
  return *this;
}

Json Flicker::json() const {
  if (pixels == 0) return nullptr;
  return {{"render", rms(render, pixels)}, {"ground_truth", rms(ground_truth, pixels)}};
}

std::string Flicker::text() const {
  if (pixels == 0) return "";
  return fmt::format(
      "flicker of static pixels {:.3f} of 255 from frame to frame (ground truth {:.3f})\n",
      rms(render, pixels), rms(ground_truth, pixels));
}

Flicker flicker_of(const FramePair& pair) {
  Flicker sum;
  const std::size_t pixels = static_cast<std::size_t>(pair.truth.width) * pair.truth.height;
  for (std::size_t i = 0; i < pixels; ++i) {
    const std::uint8_t* background = &pair.background.data[3 * i];
    const std::uint8_t *before = &pair.truth_before.data[3 * i], *now = &pair.truth.data[3 * i];
    if (is_moving(before, background) || is_moving(now, background)) continue;
    ++sum.pixels;
    for (int c = 0; c < 3; ++c) {
      const double change = pair.render.plane(c)[i] - pair.render_before.plane(c)[i];
      const double true_change = (now[c] - before[c]) / 255.0;
      sum.render += change * change;
      sum.ground_truth += true_change * true_change;
    }
  }
  return sum;
}

void FlickerMeter::begin(const std::vector<encoder::Camera>& cameras, std::uint64_t memory,
                         const encoder::LogSink& log) {
  constexpr std::uint64_t kPixel = 3 * sizeof(float) + 3;
  std::uint64_t bytes = 0;
  for (const encoder::Camera& camera : cameras)
    bytes += kPixel * static_cast<std::uint64_t>(camera.width) * camera.height;
  last_.clear();
  if (bytes <= memory / 2) {
    last_.resize(cameras.size());
  } else if (log) {
    log(1, fmt::format("flicker is not measured: it needs {} for {} cameras, more than half of "
                       "--memory; select fewer --cameras, or raise it",
                       human_bytes(bytes), cameras.size()));
  }
}

Flicker FlickerMeter::add(std::size_t camera, Image render, encoder::Image8 ground_truth,
                          const encoder::Image8& background) {
  Flicker flicker;
  if (last_.empty() || background.data.empty()) return flicker;
  LastFrame& last = last_[camera];
  if (!last.ground_truth.data.empty())
    flicker = flicker_of({last.render, render, last.ground_truth, ground_truth, background});
  last = {std::move(render), std::move(ground_truth)};
  return flicker;
}

}  // namespace stgs::tools
