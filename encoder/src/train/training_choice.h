// SPDX-License-Identifier: Apache-2.0
// What TrainSettings come to, before anything of a capture is read.
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

// kUsage where a setting is none, or not possible.
Result<TrainingChoice> choose_training(const TrainSettings& settings);

// settings_id() of a run whose settings came to this.
std::uint64_t settings_id_of(const TrainSettings& settings, const TrainingChoice& choice,
                             const PerceptualTerm& perceptual);

// What such a run asks of its backend. `cameras`, of which those that are not held out count, may
// be none while they are not known.
TrainPlan train_plan(const TrainingChoice& choice, const PerceptualTerm& perceptual,
                     const std::vector<Camera>& cameras);

}  // namespace stgs::encoder
