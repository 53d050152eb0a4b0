// SPDX-License-Identifier: Apache-2.0
// The perceptual loss term of a run: whether it is on, its network, and the patch of each step.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backend/backend.h"
#include "perceptual/feature_network.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/train.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

class PerceptualTerm {
 public:
  // Reads the weights if the settings name a file, and logs the state of the term. Returns the
  // backend's error if it cannot compute the loss; kInvalidFile for an invalid file.
  static Result<PerceptualTerm> create(const TrainSettings& settings,
                                       const HyperParameters& parameters,
                                       const TrainBackend& backend, const LogSink& log);

  bool is_on() const { return network_ != nullptr; }
  // Returns kUsage if a training image is too small, also at half size if the run uses that.
  Status check_sizes(const std::vector<Camera>& cameras) const;
  // Sets the plan's network and patch size, and raises its image size to the smallest patch.
  void plan(TrainPlan& plan) const;
  // Sets the weight and the patch of a step. `progress`: of the run, in [0, 1]. `input` must have
  // its camera set.
  void apply(std::uint64_t seed, std::uint64_t iteration, double progress, StepInput& input) const;
  // Returns the fingerprint entry that a resumed run must match.
  std::string fingerprint() const;
  std::optional<PerceptualReport> report() const;

 private:
  std::string file_;
  std::shared_ptr<const FeatureNetwork> network_;  // null: off
  double weight_ = 0, from_ = 0;
  int patch_ = 0;
  bool half_sizes_ = false;
};

}  // namespace stgs::encoder
