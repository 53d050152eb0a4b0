// SPDX-License-Identifier: Apache-2.0
// The training log: one JSON object per line (tools/schema/training_log.json), of two kinds:
//   {"iteration", "seconds", "loss", "l1", "ssim", "normal", "perceptual", "primitives",
//    "visible"}                                                              a step, periodically
//   {"iteration", "seconds", "held_out": {"psnr", "psnr_cc", "images"}}      an evaluation
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "stgs/encoder/held_out.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct LoggedStep {
  std::uint64_t iteration = 0;
  double seconds = 0;  // of training, accumulated over resumed runs
  double loss = 0;     // running mean
  double l1 = 0, ssim = 0;
  double normal = 0;      // L_n before weighting; 0 if it is off
  double perceptual = 0;  // L_lpips before weighting; 0 if it is off
  std::uint64_t primitives = 0, visible = 0;
};

struct LoggedEvaluation {
  std::uint64_t iteration = 0;
  double seconds = 0;
  HeldOutScore score;
};

struct TrainingLog {
  std::vector<LoggedStep> steps;
  std::vector<LoggedEvaluation> evaluations;
};

// Reads a log, in file order. kInvalidFile, with the line number, if a line is of neither kind. An
// incomplete last line, which a killed run may leave, is ignored.
Result<TrainingLog> read_training_log(const std::string& path);

}  // namespace stgs::encoder
