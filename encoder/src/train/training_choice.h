// SPDX-License-Identifier: Apache-2.0
// Resolves TrainSettings, before anything of a capture is read.
#pragma once

#include "backend/backend.h"
#include "stgs/encoder/train.h"
#include "train/ablation.h"
#include "train/hyper_parameters.h"
#include "train/perceptual_term.h"

namespace stgs::encoder {

struct TrainingChoice {
  HyperParameters parameters;
  Ablation ablation;
};

// Resolves the settings. kUsage for an invalid setting or one that has no effect.
Result<TrainingChoice> choose_training(const TrainSettings& settings);

// Returns the parameters of a run that grows.
// - A limit of the file also limits the primitives before the compaction, unless their number is
//   set: from many more than remain in the end, it would have to remove primitives that the others
//   then cannot replace.
// - L_n is for sparse rigs (rig.h); elsewhere its weight is smaller or 0, unless it is set.
HyperParameters growth_parameters(const HyperParameters& parameters, const TrainSettings& settings,
                                  const PreparedCapture& capture);

// Returns the requirements of a run on its backend. Ignores held-out cameras. `cameras` may be
// empty if they are not known yet.
TrainPlan train_plan(const TrainingChoice& choice, const PerceptualTerm& perceptual,
                     const std::vector<Camera>& cameras);

}  // namespace stgs::encoder
