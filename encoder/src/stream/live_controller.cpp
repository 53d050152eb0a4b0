// SPDX-License-Identifier: Apache-2.0
#include "live_controller.h"

#include <algorithm>
#include <cmath>

namespace stgs::encoder {
namespace {

// A frame waits for its window to fill, to be prepared and to be trained.
constexpr double kStages = 3;
constexpr int kMinWindow = 8;      // frames; in fewer, moving content looks static
constexpr int kMaxBacklog = 4;     // windows that become one
constexpr double kReserve = 0.9;   // of the time of a window
constexpr double kCatchUp = 0.25;  // of it with a backlog
constexpr int kMinIterations = 60;
// Fractions of the primitives of a window. A larger one than kMaxKeep costs bytes and time for
// little quality.
constexpr double kMinKeep = 0.1, kMaxKeep = 0.85;
constexpr double kLearn = 0.3;  // weight of a new duration
// Seconds on an NVIDIA H200 with 16 cores, 27 cameras of 640x360: of preparing a window, per frame
// with points, of training a window, per iteration.
constexpr double kPrepare = 0.05, kPoints = 0.015, kTrain = 0.07, kStep = 0.0003;

}  // namespace

double WorkTime::amount(double seconds) const {
  return std::max(0.0, (seconds / slowness_ - fixed_) / each_);
}

void WorkTime::learn(double amount, double seconds) {
  slowness_ += kLearn * (seconds / (fixed_ + amount * each_) - slowness_);
}

LiveController::LiveController(double fps, double latency, int iterations)
    : fps_(fps),
      window_(std::max(kMinWindow, static_cast<int>(std::lround(latency / kStages * fps)))),
      max_iterations_(std::max(kMinIterations, iterations)),
      keep_(kMaxKeep),
      points_(kPrepare, kPoints),
      steps_(kTrain, kStep) {}

double LiveController::budget(int frames, int waiting) const {
  const bool has_backlog = waiting > window_ || 2 * frames > 3 * window_;
  return (has_backlog ? kCatchUp : kReserve) * frames / fps_;
}

int LiveController::frames(int ready) const {
  return std::clamp(ready, window_, kMaxBacklog * window_);
}

int LiveController::point_interval(int frames, int waiting) const {
  const double affordable = points_.amount(budget(frames, waiting));
  const int with_points = std::clamp(static_cast<int>(affordable), 1, frames);
  return (frames + with_points - 1) / with_points;
}

int LiveController::iterations(int frames, int waiting) const {
  const double affordable = steps_.amount(budget(frames, waiting));
  return static_cast<int>(std::clamp(affordable, double{kMinIterations}, double(max_iterations_)));
}

bool LiveController::wrote(int frames, double bytes, double kbps) {
  const double limit = 125.0 * kbps * frames / fps_;
  const bool is_over = bytes > limit;
  const bool can_reduce = keep_ > kMinKeep;
  // Bytes are proportional to the primitives. The square root damps the response, because windows
  // differ.
  keep_ = std::clamp(keep_ * std::sqrt(limit / std::max(1.0, bytes)), kMinKeep, kMaxKeep);
  return !is_over || can_reduce;
}

void LiveController::prepared(int frames, int point_interval, double seconds) {
  points_.learn(std::max(1, frames / point_interval), seconds);
}

void LiveController::trained(int iterations, double seconds) {
  if (iterations > 0) steps_.learn(iterations, seconds);
}

void LiveController::first_trained(int iterations, double seconds) {
  if (iterations > 0) steps_.set_each(seconds / iterations);
}

}  // namespace stgs::encoder
