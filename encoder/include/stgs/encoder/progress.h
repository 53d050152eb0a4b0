// SPDX-License-Identifier: Apache-2.0
// Progress and log callbacks of long-running operations.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace stgs::encoder {

// Details of the stage "train".
struct TrainProgress {
  std::uint64_t iteration = 0, iterations = 0;  // views processed, and their total
  double loss = 0;                              // running mean
  std::uint64_t primitives = 0;
  std::optional<double> held_out_psnr;  // of the latest evaluation, dB
};

struct Progress {
  std::string stage;        // "calibrate", "flow", "train", ...
  double done = 0;          // fraction of this stage, 0..1, monotonic
  double eta_seconds = -1;  // remaining time of this stage; negative: unknown
  std::string detail;       // human-readable: loss, counts
  std::optional<TrainProgress> training = std::nullopt;
};

// Receives progress on the thread that started the operation. Returns false to cancel it.
using ProgressSink = std::function<bool(const Progress&)>;

// Receives one human-readable line. Levels: 0 error, 1 warning, 2 information, 3 debug.
using LogSink = std::function<void(int level, const std::string& line)>;

}  // namespace stgs::encoder
