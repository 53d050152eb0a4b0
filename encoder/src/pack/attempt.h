// SPDX-License-Identifier: Apache-2.0
// One attempt to pack a scene: encoding, decoding, errors.
#pragma once

#include <functional>
#include <optional>

#include "pack/rate.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {

// The primitive with the max_error position error at any time.
struct WorstPrimitive {
  double error = HUGE_VAL;  // scene units
  std::size_t primitive = 0;
  math::Vec3 position{};   // at its T, as decoded
  bool by_motion = false;  // the error is due to its motion, not to its position at its T
};

// Packs at a quality and decodes the result; 0: at the scene's own steps or the default quality.
// Uses the first bound on quantisation steps that meets max_error; it must be tighter than
// max_error if a lifespan is rounded too. If no bound does, sets `too_far` to the primitive of the
// attempt with the smallest error. Calls `before_attempt` first, and stops with its error.
Result<Packed> pack_at(const Scene& scene, const PackSettings& settings, double quality,
                       const std::function<Status()>& before_attempt,
                       std::optional<WorstPrimitive>& too_far);

// Returns the error of a max_error that cannot be met.
Status unreachable_error(const Scene& scene, const PackSettings& settings,
                         const WorstPrimitive& worst);

}  // namespace stgs::encoder
