// SPDX-License-Identifier: Apache-2.0
// Saving the state of a run, and resuming it.
#include "train/checkpoint.h"
#include "train/densify_plan.h"
#include "train/trainer.h"

namespace stgs::encoder {

Status Trainer::resume() {
  STGS_ASSIGN(Checkpoint checkpoint, read_checkpoint(settings_.resume));
  STGS_TRY(check_same_run(settings_.resume, checkpoint.fingerprint, fingerprint()));
  STGS_TRY(check_state(settings_.resume, checkpoint.state, capture_, growth_.sh_degree,
                       !ablation_.representation,
                       settings_.refine_cameras || settings_.refine_timing));
  const std::string before = value_of(checkpoint.fingerprint, kBackendEntry);
  if (before != backend_->name()) {
    log_(1,
         fmt::format("{}: written with the backend {} and resumed with {}; the scene will have the "
                     "same quality, but not the same bits as from an uninterrupted run",
                     settings_.resume, before, backend_->name()));
  }
  const std::string processes = value_of(checkpoint.fingerprint, kProcessesEntry);
  if (processes != fmt::format("{}", ranks_.size())) {
    log_(1,
         fmt::format("{}: number of processes was {} and is now {}; the scene will have the same "
                     "quality, but not the same bits as from an uninterrupted run",
                     settings_.resume, processes, ranks_.size()));
  }
  state_ = std::move(checkpoint.state);
  seconds_before_ = state_.seconds;
  first_iteration_ = state_.iteration;
  log_(2, fmt::format("resumed at iteration {} from {}", state_.iteration, settings_.resume));
  return {};
}

Status Trainer::save_checkpoint() {
  if (settings_.checkpoint.empty()) return {};
  STGS_TRY(synchronise());
  return ranks_.is_first() ? write_checkpoint(settings_.checkpoint, state_, fingerprint())
                           : Status();
}

Status Trainer::save_checkpoint_if_possible() {
  if (settings_.checkpoint.empty()) return {};
  STGS_TRY(synchronise());
  if (!ranks_.is_first()) return {};
  const Status written = write_checkpoint(settings_.checkpoint, state_, fingerprint());
  // A full disk stays full, so only the first failure and that at the end are logged.
  if (!written.ok() && (!checkpoint_failed_ || finished())) {
    log_(1, fmt::format("iteration {}: the checkpoint could not be written ({}); training {}",
                        state_.iteration, written.message(),
                        finished() ? "is complete" : "continues"));
  }
  checkpoint_failed_ = !written.ok();
  return {};
}

Status Trainer::save_completed_steps(const Status& error) {
  step_failed_ = false;
  if (ranks_.ranks() != nullptr || settings_.checkpoint.empty()) return error;
  state_.iteration -= backend_->abandon();
  state_.second_stage =
      densify_plan(parameters_, ablation_, growth_progress(), false).second_stage ? 1 : 0;
  const Status saved = save_checkpoint();
  if (!saved.ok()) {
    log_(1, saved.message());
    return error;
  }
  return Status(error.code(), fmt::format("{}; {} iterations are complete, resume with --resume {}",
                                          error.message(), state_.iteration, settings_.checkpoint));
}

std::string Trainer::resume_hint() const {
  // A run that was already complete has no progress beyond the checkpoint that it resumed.
  const bool unchanged = !settings_.resume.empty() && state_.iteration == first_iteration_;
  const std::string& from =
      settings_.checkpoint.empty() && unchanged ? settings_.resume : settings_.checkpoint;
  return from.empty() ? "no checkpoint was written (no --checkpoint)"
                      : fmt::format("resume with --resume {}", from);
}

// The part that must be identical on all ranks. It excludes the images, which may be copies.
Fingerprint Trainer::settings_fingerprint() const {
  Fingerprint all = fingerprint_of(parameters_, settings_);
  const Fingerprint capture = fingerprint_of(capture_);
  all.insert(all.end(), capture.begin(), capture.end());
  all.emplace_back("perceptual weights", perceptual_.fingerprint());
  all.emplace_back("free space", fingerprint_of(free_space_));
  all.emplace_back(kProcessesEntry, fmt::format("{}", ranks_.size()));
  return all;
}

Fingerprint Trainer::fingerprint() const {
  Fingerprint all = settings_fingerprint();
  all.insert(all.end(), image_fingerprint_.begin(), image_fingerprint_.end());
  all.emplace_back(kBackendEntry, backend_->name());
  return all;
}

}  // namespace stgs::encoder
