// SPDX-License-Identifier: Apache-2.0
// Which primitives of a trained window persist: static content that is visible from the window's
// first frame to its last is expected to stay.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/scene_file.h"
#include "train/train_state.h"

namespace stgs::encoder {

// The half length of a persistent lifespan, frames: longer than any capture (kCaptureLimits).
inline constexpr float kPersistentRadius = 4e6f;

// Returns whether a primitive was made static by persist(): stored, or a candidate
// (set_growth.h).
inline bool is_persistent(const TrainState& state, std::size_t i) {
  return state.is_fixed(i) || state.set.radius[i] >= kPersistentRadius;
}

// Lists the primitives of a window of `frames` frames, of the paper's representation, that persist,
// fixed ones included: those that hardly move and fade within it, and that enough views have
// trained. The state's times count from the first frame. `first`: frame from which on they need to
// be visible.
std::vector<std::uint32_t> list_persistent(const TrainState& state, int frames, int first = 0);

// Reduces a list of primitives to those at places that are still (FrameMemory::still()) in at least
// half of the training cameras that they project into. All of them if the capture does not state
// it.
std::vector<std::uint32_t> list_still(const PreparedCapture& capture, const Gaussians4D& set,
                                      const std::vector<std::uint32_t>& primitives);

// Returns the state that the next window starts from: the primitives of `persistent`, then
// `carried`, with the colours and cameras of a trained state. Those of `stored` are fixed, and
// those that were; those of `carried` are moved to the next window, after one of `frames` frames.
// `carried` and `stored` ascend; `persistent` and `carried` have nothing in common.
TrainState persistent_state(const TrainState& trained, const std::vector<std::uint32_t>& persistent,
                            const std::vector<std::uint32_t>& carried,
                            const std::vector<std::uint32_t>& stored, int frames);

// Reduces a window's scene, which has all primitives of the state, to those that are not fixed, in
// two parts, both as long as the window: those that end with it, then the `stored` ones
// (ascending), which stay.
void split_window(const TrainState& state, const std::vector<std::uint32_t>& stored, Scene& scene);

// Lists the other primitives that the next window starts from: moving content that is visible in
// the last frame. Neither fixed ones nor those of `persistent` (ascending).
std::vector<std::uint32_t> list_carried(const TrainState& state, int frames,
                                        const std::vector<std::uint32_t>& persistent);

// Moves primitive i to the first frame of the next window, with its velocity and the lifespan of an
// initial point there.
void carry(TrainState& state, std::size_t i, int frames);

// Makes primitive i static, and visible at all times as it is on average in frames [first, frames)
// of the window.
void persist(TrainState& state, std::size_t i, int first, int frames);

// Ends the lifespan of a persistent primitive before a frame of the window.
void end_at(Gaussians4D& set, std::size_t i, int frame);

}  // namespace stgs::encoder
