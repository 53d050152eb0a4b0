// SPDX-License-Identifier: Apache-2.0
// Temporal flicker: how much static content changes from frame to frame.
#pragma once

#include <cstdint>

#include "session.h"
#include "stgs/encoder/prepared_capture.h"
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

}  // namespace stgs::tools
