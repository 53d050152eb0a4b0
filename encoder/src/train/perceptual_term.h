// SPDX-License-Identifier: Apache-2.0
// The perceptual term of a run: whether there is one, its network, and where a step looks.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backend/backend.h"
#include "perceptual/vgg16.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/train.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

class PerceptualTerm {
 public:
  // Reads the weights where the settings name a file, and says in the log what becomes of the term.
  // The backend's error where it cannot work on it; kInvalidFile for a file that is none.
  static Result<PerceptualTerm> create(const TrainSettings& settings,
                                       const HyperParameters& parameters,
                                       const TrainBackend& backend, const LogSink& log);

  bool on() const { return network_ != nullptr; }
  // kUsage where a training picture, also at half size where the run uses that, is too small.
  Status check_sizes(const std::vector<Camera>& cameras) const;
  void plan(TrainPlan& plan) const;
  // For the step of this iteration, at this share of the run; the camera is set.
  void apply(std::uint64_t seed, std::uint64_t iteration, double share, StepInput& input) const;
  // What a continuation depends on.
  std::string fingerprint() const;
  std::optional<PerceptualReport> report() const;

 private:
  std::string file_;
  std::shared_ptr<const Vgg16> network_;  // null: off
  double weight_ = 0, from_ = 0;
  int patch_ = 0;
  bool half_sizes_ = false;
};

}  // namespace stgs::encoder
