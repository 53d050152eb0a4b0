// SPDX-License-Identifier: Apache-2.0
// Finds how static content has changed since it joined the persistent set: primitives that no
// longer match the images, and places whose content the set lacks.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "train/changed_points.h"
#include "train/train_state.h"

namespace stgs::encoder {

// A primitive of the persistent set that the images do not show from a frame of the window on.
struct EndedPrimitive {
  std::uint32_t index = 0;  // in the state of the set
  int frame = 0;            // in [0, frames of the window)
};

inline constexpr int kUnsettled = -1;

struct SceneChanges {
  std::vector<EndedPrimitive> ended;  // ascending
  // Frame from which on no further primitive ends, or kUnsettled if that is after the middle.
  int settled = 0;
  // Static content of the frames from `settled` on that the set does not show.
  std::vector<InitialPoint> points;
  std::vector<Residual> residuals;  // for the next window
};

// Compares a window with the state of the persistent set.
//
// Content has ended if the images show the content behind it: its primitives differ from the images
// in most cameras that see them, up to the last frame, and by comparison of the images the content
// there has a greater depth or, if they do not determine one, the set matches them better without
// these primitives. Content behind moving objects stays, because the images show nearer content.
//
// `residuals`: of the previous window; empty for the second one. Without them, or with those of
// images of another size, they are those of the first frame. At most `max_points` points. The error
// is that of reading a frame.
Result<SceneChanges> find_changes(const PreparedCapture& capture, const TrainState& set,
                                  const std::vector<Residual>& residuals, int kernel,
                                  std::size_t max_points);

// Returns for each fixed primitive of a state, in order, the frame at which it ends, or -1. Their
// order remains while other primitives come and go.
std::vector<int> ends_of_fixed(const TrainState& state, const SceneChanges& changes);

}  // namespace stgs::encoder
