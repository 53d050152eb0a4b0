// SPDX-License-Identifier: Apache-2.0
// Which primitives of a trained window persist: static content that is visible from the window's
// first frame to its last is expected to stay.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/scene_file.h"
#include "train/train_state.h"

namespace stgs::encoder {

// The half length of a persistent lifespan, frames: longer than any capture (kCaptureLimits).
inline constexpr float kPersistentRadius = 4e6f;

// Further static primitives are stored once they are this fraction of the stored ones, so that few
// parts of the file cover a time. Until then they are candidates: part of their window's content,
// and trained further in the next window.
inline constexpr double kMinStoredShare = 0.02;

// Lists the primitives of a window of `frames` frames, of the paper's representation, that persist,
// fixed ones included: those that hardly move and fade within it, and that enough views have
// trained. The state's times count from the first frame.
std::vector<std::uint32_t> list_persistent(const TrainState& state, int frames);

// Returns the state of a persistent set: the listed primitives, with the colours and cameras of a
// trained state. With `store`, all of them are fixed, else those that were.
TrainState persistent_state(const TrainState& trained, const std::vector<std::uint32_t>& persistent,
                            bool store);

// Reduces a window's scene, which has all primitives of the state, to those that are not fixed, in
// two parts, both as long as the window: those that end with it, then the `stored` ones
// (ascending), which stay.
void split_window(const TrainState& state, const std::vector<std::uint32_t>& stored, Scene& scene);

// Makes primitive i static, and visible at all times as it is on average in the window.
void persist(TrainState& state, std::size_t i, int frames);

}  // namespace stgs::encoder
