// SPDX-License-Identifier: Apache-2.0
// The state before the first step, from the prepared capture's points (paper 3.3).
#pragma once

#include <cstdint>

#include "stgs/encoder/persistent_set.h"
#include "stgs/encoder/prepared_capture.h"
#include "train/ablation.h"
#include "train/hyper_parameters.h"
#include "train/scene_changes.h"
#include "train/train_state.h"

namespace stgs::encoder {

// Creates primitives from the capture's points: dynamic ones are centred on their frame and have
// their measured motion; static ones are active over the complete clip.
// - Too many points are reduced to a random selection. For dynamic points it depends on the seed.
//   For static points it is the same for all windows and seeds, or its first part if a window has
//   more dynamic points.
// - The background is estimated for the complete capture, independent of window and seed (except
//   for rounding, because the initial scene is rendered to estimate it).
// - `persistent`: the persistent set of a window, or null; empty for the first one. Its primitives
//   come first; they replace the static points. Background, colours and cameras are those of the
//   set. `changes`, not null then, receives the changes of static content; primitives that end are
//   visible until then, and static points are those of the changes.
// kUsage if the initialisation is ablated but the capture has no dynamic points; kInvalidFile if
// the set belongs to another run.
Result<TrainState> initial_state(const PreparedCapture& capture, const HyperParameters& parameters,
                                 const Ablation& ablation, std::uint64_t seed,
                                 const PersistentSet* persistent = nullptr,
                                 SceneChanges* changes = nullptr);

}  // namespace stgs::encoder
