// SPDX-License-Identifier: Apache-2.0
// Reports of a running training: progress, log entries and held-out scores.
#include <algorithm>
#include <chrono>
#include <stdexcept>

#include "stgs/encoder/metrics.h"
#include "train/trainer.h"

namespace stgs::encoder {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kLogInterval = 50;  // iterations

}  // namespace

Result<bool> Trainer::report_progress() {
  reported_ = Clock::now();
  if (!progress_) {
    STGS_ASSIGN(const bool stop, ranks_.any(false));
    return !stop;
  }
  const double progress = run_progress();
  const double eta = progress > 0 ? state_.seconds * (1.0 - progress) / progress : -1;
  std::string detail = fmt::format("iteration {}, loss {:.4f}, {} primitives", state_.iteration,
                                   state_.mean_loss, backend_->size());
  if (score_) detail += fmt::format(", held-out psnr {:.2f} dB", score_->psnr);
  TrainProgress training{state_.iteration, static_cast<std::uint64_t>(parameters_.iterations),
                         state_.mean_loss, backend_->size(), std::nullopt};
  if (score_) training.held_out_psnr = score_->psnr;
  STGS_ASSIGN(const bool stop, ranks_.any(!progress_({"train", progress, eta, detail, training})));
  return !stop;
}

double Trainer::recent_psnr() const {
  const std::uint64_t steps = steps_read_ - first_iteration_;
  if (steps == 0) return 0;
  const std::uint64_t count = std::clamp<std::uint64_t>(steps / 4, 1, errors_.size());
  double sum = 0;
  for (std::uint64_t k = 0; k < count; ++k) sum += errors_[(steps_read_ - k) % errors_.size()];
  return psnr_of(sum / static_cast<double>(count));
}

bool Trainer::log_due() const {
  const bool first_step = state_.iteration <= static_cast<std::uint64_t>(ranks_.size());
  return !settings_.log_path.empty() && (first_step || passed(kLogInterval) || finished());
}

void Trainer::write_log() {
  log_file_.write(LoggedStep{state_.iteration, state_.seconds, state_.mean_loss, last_.l1,
                             last_.ssim, last_.normal, last_.perceptual, backend_->size(),
                             last_.visible});
}

int Trainer::evaluations_due() const {
  return static_cast<int>(run_progress() * settings_.held_out_evaluations);
}

Status Trainer::evaluate_held_out() {
  // With several ranks, rank 0 evaluates and all synchronise their states.
  const bool evaluates =
      ranks_.size() > 1 ? settings_.held_out_evaluations > 0 : !held_out_.empty();
  if (!evaluates || evaluations_due() == evaluations_done_) return {};
  evaluations_done_ = evaluations_due();
  STGS_TRY(read_steps());
  const Clock::time_point begin = Clock::now();
  STGS_TRY(backend_->synchronise());
  if (held_out_.empty()) return {};
  clock_.begin("held-out images");
  if (score_held_out()) {
    log_file_.write(LoggedEvaluation{state_.iteration, state_.seconds, *score_});
  }
  started_ += Clock::now() - begin;
  clock_.begin("training steps");
  return {};
}

bool Trainer::score_held_out() {
  try {
    score_ = held_out_.evaluate(state_.compaction.is_rounding() ? rounded_set(state_) : state_.set,
                                state_.background, parameters_.kernel);
    return true;
  } catch (const std::length_error& error) {
    log_(1, fmt::format("iteration {}: held-out views could not be rendered: {}", state_.iteration,
                        error.what()));
    score_.reset();
    return false;
  }
}

}  // namespace stgs::encoder
