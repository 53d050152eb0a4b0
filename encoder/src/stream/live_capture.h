// SPDX-License-Identifier: Apache-2.0
// The capture of a window of a live capture.
#pragma once

#include <vector>

#include "live_queue.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// Returns how often images of a rig may be halved: up to kMaxHalvings, and while the shorter side
// of all cameras remains 64 pixels or more.
int max_halvings(const std::vector<Camera>& cameras);

// Returns the number of images that the cameras taking part have not delivered. `taking_part`:
// their indices in the images of a frame.
std::uint64_t count_missing(const LiveFrames& frames, const std::vector<std::size_t>& taking_part);

// Returns the capture of the frames of a window, in memory, whose images and cameras are halved
// `halvings` times. `rig`: the cameras that take part, in the order of `taking_part`.
PreparedCapture live_capture(const PreparedCapture& rig,
                             const std::vector<std::size_t>& taking_part, const LiveFrames& frames,
                             int halvings);

}  // namespace stgs::encoder
