// SPDX-License-Identifier: Apache-2.0
#include "live_controller.h"

#include <algorithm>
#include <cmath>

#include "stgs/encoder/prepare.h"

namespace stgs::encoder {
namespace {

// A frame waits for its window to fill, to be prepared and to be trained.
constexpr double kStages = 3;
constexpr int kMaxBacklog = 4;     // windows that become one
constexpr double kReserve = 0.9;   // of the time of a window
constexpr double kCatchUp = 0.25;  // of it with a backlog
constexpr int kMinIterations = 60;
// Fractions of the primitives of a window. A larger one than kMaxKeep costs bytes and time for
// little quality.
constexpr double kMinKeep = 0.1, kMaxKeep = 0.85;
constexpr double kLearn = 0.3;  // weight of a new duration
// Windows before images are halved, and before they are enlarged, at least and at most.
constexpr int kSlowWindows = 3, kCalmWindows = 10, kMaxCalmWindows = 160;
// The work of a window that has time for larger images, which take up to kPixelRatio times as long.
constexpr int kSpareIterations = 5 * kMinIterations, kSparePointInterval = 2;
constexpr double kPixelRatio = 4;
// Seconds on an NVIDIA H200 with 16 cores, 27 cameras of 640x360: of preparing a window, per frame
// with points, of training a window, per iteration.
constexpr double kPrepare = 0.05, kPoints = 0.015, kTrain = 0.07, kStep = 0.0003;

}  // namespace

double WorkTime::amount(double seconds) const {
  return std::max(0.0, (seconds / slowness_ - fixed_) / each_);
}

void WorkTime::learn(double amount, double seconds) {
  const double found = seconds / (fixed_ + amount * each_);
  slowness_ += (is_expected_ ? 1 : kLearn) * (found - slowness_);
  is_expected_ = false;
}

void LiveController::Stage::rate(bool is_least, bool is_much, double seconds, double window) {
  slow_windows = is_least && seconds > kReserve * window ? slow_windows + 1 : 0;
  // The work is chosen to take the time less the reserve, and may take somewhat longer.
  has_spare = is_much && seconds <= window;
}

void LiveController::Stage::change_size(double factor) {
  time.expect(factor);
  slow_windows = 0;
  has_spare = false;
}

LiveController::LiveController(double fps, double latency, int iterations)
    : fps_(fps),
      window_(std::max(kMinWindowFrames, static_cast<int>(std::lround(latency / kStages * fps)))),
      max_iterations_(std::max(kMinIterations, iterations)),
      keep_(kMaxKeep),
      points_{WorkTime(kPrepare, kPoints)},
      steps_{WorkTime(kTrain, kStep)},
      calm_required_(kCalmWindows) {}

bool LiveController::has_backlog(int frames, int waiting) const {
  return waiting > window_ || 2 * frames > 3 * window_;
}

double LiveController::budget(int frames, int waiting) const {
  return (has_backlog(frames, waiting) ? kCatchUp : kReserve) * frames / fps_;
}

int LiveController::frames(int ready) const {
  return std::clamp(ready, window_, kMaxBacklog * window_);
}

int LiveController::point_interval(int frames, int waiting) const {
  const double affordable = points_.time.amount(budget(frames, waiting));
  const int with_points = std::clamp(static_cast<int>(affordable), 1, frames);
  return (frames + with_points - 1) / with_points;
}

int LiveController::iterations(int frames, int waiting) const {
  const double affordable = steps_.time.amount(budget(frames, waiting));
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

void LiveController::prepared(int halvings, int frames, int point_interval, double seconds) {
  if (halvings != halvings_) return;
  const int with_points = std::max(1, frames / point_interval);
  points_.time.learn(with_points, seconds);
  points_.rate(with_points == 1, point_interval <= kSparePointInterval, seconds, frames / fps_);
}

void LiveController::trained(int halvings, int frames, int iterations, double seconds) {
  if (halvings != halvings_ || iterations == 0) return;
  steps_.time.learn(iterations, seconds);
  steps_.rate(iterations <= kMinIterations,
              iterations >= std::min(kSpareIterations, max_iterations_), seconds, frames / fps_);
}

void LiveController::first_trained(int iterations, double seconds) {
  if (iterations > 0) steps_.time.set_each(seconds / iterations);
}

int LiveController::choose_halvings(int ready, bool overflowed) {
  ++at_size_;
  const int slow = std::max(points_.slow_windows, steps_.slow_windows);
  const bool is_calm = points_.has_spare && steps_.has_spare && !has_backlog(ready, 0);
  calm_windows_ = is_calm ? calm_windows_ + 1 : 0;
  has_overflowed_ = overflowed || (has_overflowed_ && !is_calm);
  if (slow >= (has_overflowed_ ? 1 : kSlowWindows) && halvings_ < max_halvings_)
    halve();
  else if (calm_windows_ >= calm_required_ && halvings_ > 0)
    enlarge();
  return halvings_;
}

void LiveController::halve() {
  const bool was_just_enlarged = has_enlarged_ && at_size_ <= 2 * calm_required_;
  calm_required_ = was_just_enlarged ? std::min(2 * calm_required_, kMaxCalmWindows) : kCalmWindows;
  has_enlarged_ = false;
  change_size(halvings_ + 1, 1);
}

void LiveController::enlarge() {
  has_enlarged_ = true;
  change_size(halvings_ - 1, kPixelRatio);
}

void LiveController::change_size(int halvings, double factor) {
  halvings_ = halvings;
  at_size_ = calm_windows_ = 0;
  has_overflowed_ = false;
  points_.change_size(factor);
  steps_.change_size(factor);
}

}  // namespace stgs::encoder
