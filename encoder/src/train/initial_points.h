// SPDX-License-Identifier: Apache-2.0
// The points of a prepared capture that training starts from.
#pragma once

#include <vector>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

struct InitialPoints {
  std::vector<InitialPoint> statics;
  bool is_moving = false;              // the complete capture has dynamic points
  std::vector<InitialPoint> dynamics;  // of the capture's frames; `frame` counts from frame 0
};

// Reads the points of a capture, or of the window that it describes. kIo if a file that `stgs
// prepare` always writes is missing, kInvalidFile for a frame that the capture does not have.
// `with_statics`: false leaves the static points empty.
Result<InitialPoints> read_initial_points(const PreparedCapture& capture, bool with_statics = true);

}  // namespace stgs::encoder
