// SPDX-License-Identifier: Apache-2.0
// How long work tells its caller where it is.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace stgs::encoder {

// Of the stage "train".
struct TrainProgress {
  std::uint64_t iteration = 0, iterations = 0;  // views learnt from, of how many
  double loss = 0;                              // running mean
  std::uint64_t primitives = 0;
  std::optional<double> held_out_psnr;  // of the last measure, dB
};

struct Progress {
  std::string stage;        // "calibrate", "flow", "train", ...
  double done = 0;          // 0..1 of this stage, never falling
  double eta_seconds = -1;  // of this stage; negative: unknown
  std::string detail;       // for a person: loss, counts
  std::optional<TrainProgress> training = std::nullopt;
};

// Called on the thread that started the work; returns false to cancel.
using ProgressSink = std::function<bool(const Progress&)>;

// One line for a person; level 0 errors, 1 warnings, 2 information, 3 details.
using LogSink = std::function<void(int level, const std::string& line)>;

}  // namespace stgs::encoder
