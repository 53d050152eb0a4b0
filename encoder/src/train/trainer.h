// SPDX-License-Identifier: Apache-2.0
// The training loop: schedules, sampling of views, densification, checkpoints, log.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backend/backend.h"
#include "stgs/encoder/train.h"
#include "train/fingerprint.h"
#include "train/hyper_parameters.h"
#include "train/initial_state.h"
#include "train/lockstep.h"
#include "train/log_writer.h"
#include "train/perceptual_term.h"
#include "train/training_choice.h"
#include "train/training_images.h"
#include "train/view_order.h"

namespace stgs::encoder {

class Trainer {
 public:
  static Result<std::unique_ptr<Trainer>> create(const PreparedCapture& capture,
                                                 const TrainSettings& settings,
                                                 const ProgressSink& progress, const LogSink& log);

  // Runs to the end, or until the progress sink says stop (then a checkpoint is written and the
  // Status says so).
  Status run();
  // The scene as trained so far.
  // After run(). On the first rank alone it has the importances, which others do not need.
  Result<Scene> scene();
  TrainReport report() const;

 private:
  Trainer(const PreparedCapture& capture, const TrainSettings& settings, ProgressSink progress,
          LogSink log);

  Status prepare_state();
  Status resume();
  Status prepare_ranks();
  Status prepare_backend();
  Status load_frames();
  Fingerprint settings_fingerprint() const;
  Fingerprint fingerprint() const;
  // Share of the schedule that is done, [0, 1].
  double share() const;
  bool finished() const { return share() >= 1.0; }
  // The coupled representation's axes are eigenvectors of what it learns, whose gradient has a pole
  // where two are equally long, as all are at the start; so it trains without L_n.
  bool with_normals() const { return parameters_.weight_normal > 0 && !state_.is_coupled(); }
  // Its error is that of a frame which cannot be read.
  Result<StepInput> step_input();
  double share_at(std::uint64_t iteration) const;
  // What a rank sees in the step that begins at an iteration.
  TrainingView view_at(std::uint64_t iteration, int rank);
  std::vector<BatchView> batch_views();
  // Whether the last step, which was of an iteration a rank, came to or past a multiple of n > 0.
  bool passed(std::uint64_t n) const {
    return state_.iteration / n != (state_.iteration - ranks_.size()) / n;
  }
  // Takes what the steps have given since the last time into the running mean and last_.
  Status read_steps();
  Status train();
  Status step();
  // Notes that an error, of a frame that cannot be read or for want of memory, left steps undone.
  Status undone(const Status& error);
  // After such an error: a checkpoint of the steps before, and the error with what to do. Of one
  // process alone, for others may be in the middle of the step.
  Status keep_trained(const Status& error);
  // After a step, once.
  bool densify_due();
  Status densify();
  // The state is here, and the same on all ranks.
  Status synchronise();
  // kIo where it cannot be written.
  Status save_checkpoint();
  // For whoever stopped it.
  std::string how_to_go_on() const;
  // Scene::importance; kRuntime where it is stopped.
  Result<std::vector<float>> importance();
  // As that, where the scene counts for more: what cannot be written is a warning.
  Status save_checkpoint_if_possible();
  // After a step: the clock, and whether progress is to be reported.
  Result<bool> tick();
  // False: stop.
  Result<bool> report_progress();
  bool log_due() const;
  void write_log();
  // Measures the held-out views where one is due; the clock of training stands still meanwhile.
  Status measure_held_out();
  // Into score_; false, and a warning, where they cannot be drawn.
  bool measure_held_out_now();
  int measures_due() const;

  PreparedCapture capture_;
  Fingerprint pictures_;  // as they were when it began
  TrainSettings settings_;
  HyperParameters parameters_;
  Ablation ablation_;
  PerceptualTerm perceptual_;
  ProgressSink progress_;
  LogSink log_;
  Lockstep ranks_;
  TrainingImages images_;
  TrainState state_;
  std::unique_ptr<TrainBackend> backend_;
  StepOutput last_;  // of the steps read
  bool steps_undone_ = false;
  bool checkpoint_failed_ = false;  // the last one
  std::uint64_t steps_read_ = 0;    // iterations, a view each, whose loss has been taken in
  ViewOrder order_;
  std::chrono::steady_clock::time_point started_, reported_;
  double importance_seconds_ = 0;
  double seconds_before_ = 0;          // spent by the runs that this one goes on from
  std::uint64_t first_iteration_ = 0;  // theirs
  LogWriter log_file_;
  HeldOutViews held_out_;
  double densified_ = 0;  // share of the run at which it was due last, or which a resumed run began
  int measured_ = 0;      // measures that were due so far
  std::optional<HeldOutScore> score_;
};

}  // namespace stgs::encoder
