// SPDX-License-Identifier: Apache-2.0
// The log of a training: a JSON object a line (tools/schema/training_log.json), of two kinds:
//   {"iteration", "seconds", "loss", "l1", "ssim", "normal", "perceptual", "primitives",
//    "visible"}                                                             a step, now and then
//   {"iteration", "seconds", "held_out": {"psnr", "psnr_cc", "images"}}   a measure
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "stgs/encoder/held_out.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct LoggedStep {
  std::uint64_t iteration = 0;
  double seconds = 0;  // of training, over all runs that go on from each other
  double loss = 0;     // running mean
  double l1 = 0, ssim = 0;
  double normal = 0;      // L_n before its weight; 0 where it is off
  double perceptual = 0;  // L_lpips before its weight; 0 where it is off
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

// In the order of the file. kInvalidFile, with the line, where a line is not of these kinds; a last
// line without its end, which a killed run may leave, is passed over.
Result<TrainingLog> read_training_log(const std::string& path);

}  // namespace stgs::encoder
