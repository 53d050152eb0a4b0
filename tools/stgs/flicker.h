// SPDX-License-Identifier: Apache-2.0
// Temporal flicker: how much static content changes from frame to frame.
#pragma once

#include <cstdint>
#include <vector>

#include "session.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/raster.h"

namespace stgs::tools {

// Sums of squared differences between consecutive frames over static pixels and their channels.
struct Flicker {
  double render = 0, ground_truth = 0;
  std::uint64_t pixels = 0;

  Flicker& operator+=(const Flicker& other);
  // The root mean square change of the renders and of the ground truth, of 255. null without
  // pixels.
  Json json() const;
  // As a clause of a report; empty without pixels.
  std::string text() const;
};

// Two consecutive frames of a camera, all images of the same size. A pixel is static if it does not
// move (moving.h) in either.
struct FramePair {
  const Image &render_before, &render;
  const encoder::Image8 &truth_before, &truth, &background;
};
Flicker flicker_of(const FramePair& pair);

// Measures the flicker of cameras whose frames come in order.
class FlickerMeter {
 public:
  // Starts a measurement. Logs a warning, and measures nothing, if the last frames of all cameras
  // need more than half of `memory` bytes.
  void begin(const std::vector<encoder::Camera>& cameras, std::uint64_t memory,
             const encoder::LogSink& log);
  // Compares a frame of camera number `camera` with the one before, and keeps it. No pixels for the
  // first frame, or with an empty background.
  Flicker add(std::size_t camera, Image render, encoder::Image8 ground_truth,
              const encoder::Image8& background);

 private:
  struct LastFrame {
    Image render;
    encoder::Image8 ground_truth;
  };
  std::vector<LastFrame> last_;  // per camera; none if nothing is measured
};

}  // namespace stgs::tools
