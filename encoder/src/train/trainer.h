// SPDX-License-Identifier: Apache-2.0
// The training loop: schedules, view order, densification, checkpoints and log.
#pragma once

#include <array>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backend/backend.h"
#include "stage_clock.h"
#include "stgs/encoder/persistent_set.h"
#include "stgs/encoder/train.h"
#include "train/fingerprint.h"
#include "train/hyper_parameters.h"
#include "train/initial_state.h"
#include "train/lockstep.h"
#include "train/log_writer.h"
#include "train/perceptual_term.h"
#include "train/set_growth.h"
#include "train/training_choice.h"
#include "train/training_images.h"
#include "train/view_order.h"

namespace stgs::encoder {

class Trainer {
 public:
  // Loads the state and the images, and reserves the backend's memory.
  // The objects of `window` must outlive the trainer. Takes the backend away, also on failure.
  static Result<std::unique_ptr<Trainer>> create(const PreparedCapture& capture,
                                                 const TrainSettings& settings,
                                                 const WindowState& window,
                                                 const ProgressSink& progress, const LogSink& log);

  // Runs to the end. If the progress sink cancels, writes a checkpoint and returns kRuntime.
  Status run();
  // Returns the trained scene after run(), and replaces the persistent set of a window with that
  // for the next window; null for a complete capture. Only rank 0's scene has importances.
  Result<Scene> result(PersistentSet* persistent);
  // Returns the report of the run so far.
  TrainReport report() const;
  // Gives the backend away. Nothing else may be called afterwards.
  std::shared_ptr<TrainBackend> take_backend() { return std::move(backend_); }

 private:
  Result<Scene> scene();
  void find_persistent(PersistentSet& set);
  Trainer(const PreparedCapture& capture, const TrainSettings& settings, ProgressSink progress,
          LogSink log);

  Status prepare_state();
  // Chooses the priors of a sparse rig (rig.h), and logs them.
  Status prepare_priors();
  // kUsage if there are too few cameras to refine.
  Status prepare_cameras();
  Status resume();
  Status prepare_ranks();
  Status prepare_backend();
  Status load_frames();
  Fingerprint settings_fingerprint() const;
  Fingerprint fingerprint() const;
  // Completed fraction of the schedule, [0, 1].
  double run_progress() const;
  bool finished() const { return run_progress() >= 1.0; }
  // The coupled representation trains without L_n. Its axes are eigenvectors of the learnt
  // covariance, whose gradient has a pole if two have equal length, as initially all have.
  bool with_normals() const { return growth_.weight_normal > 0 && !state_.is_coupled(); }
  // Returns the error of a frame that cannot be read.
  Result<StepInput> step_input();
  double progress_at(std::uint64_t iteration) const;
  // Returns the view of a rank in the step that begins at an iteration.
  TrainingView view_at(std::uint64_t iteration, int rank);
  std::vector<BatchView> batch_views();
  // Returns the time of a view of a training camera, with the camera's refined offset.
  float ticks_of(std::size_t camera, int frame) const {
    return static_cast<float>(capture_.time_of(images_.cameras()[camera], frame));
  }
  // Returns whether the last step, one iteration per rank, reached or passed a multiple of n > 0.
  bool passed(std::uint64_t n) const {
    return state_.iteration / n != (state_.iteration - ranks_.size()) / n;
  }
  // Reads the outputs of the steps since the last call into the running mean and last_.
  Status read_steps();
  Status train();
  // Progress of the run before the compaction, and of the compaction, [0, 1].
  double growth_progress_at(std::uint64_t iteration) const;
  double growth_progress() const { return growth_progress_at(state_.iteration); }
  double compaction_progress() const;
  // Performs the removals and the begin of rounding that are due after the latest step.
  Status compact();
  // Chooses how many primitives to keep, and the quality.
  Status choose_size();
  // Returns the bytes of a share of the primitives, the most important ones, packed at a quality.
  Result<double> packed_bytes(const Scene& scene, const std::vector<std::uint32_t>& ranked,
                              double share, double quality) const;
  // Returns the PSNR of a sample of the training images, after the best affine colour map of each.
  Result<double> training_psnr();
  // Returns whether the training images, now of this PSNR, keep the target if further primitives
  // are removed.
  bool can_prune(double now);
  // Computes the importances that decide which primitives are removed.
  Result<std::vector<float>> pruning_importance();
  // Retains the fraction of the primitives that matters most.
  Status prune(double keep);
  // Chooses the quantisation to which further steps round.
  Status begin_rounding();
  // Synchronises the state and computes its importances; a cancelled run saves its checkpoint.
  Result<std::vector<float>> importance_now();
  void set_compaction_schedule(StepInput& input) const;
  // Cameras are refined from the first steps, with blurred images, to the compaction.
  bool refines_cameras() const;
  // Applies the gradients of the views since the last update to the cameras, if one is due.
  Status update_cameras();
  // Logs how far the cameras are from their calibration, with a warning for each that is wrong.
  void report_cameras() const;
  void warn_of_lens(const RefinedCamera& refined) const;
  void warn_of_pose(const RefinedCamera& refined) const;
  void warn_of_time(const RefinedCamera& refined) const;
  // Renders with the cameras of the state from now on.
  void use_cameras();
  // Dilated splats are never thin on screen, so their scales need no limit.
  bool limits_scales() const {
    return parameters_.min_scale > 0 && parameters_.kernel == math::kBandLimited &&
           !state_.is_coupled();
  }
  // Keeps primitives from becoming smaller than the training images can resolve.
  Status limit_scales();
  Status step();
  // Records that an error (unreadable frame, out of memory) left steps incomplete; returns it.
  Status on_step_failed(const Status& error);
  // After such an error, writes a checkpoint of the completed steps and returns the error with a
  // resume hint. Only for a single process, because other ranks may be in the middle of the step.
  Status save_completed_steps(const Status& error);
  // Call once after every step.
  bool densify_due();
  Status densify();
  // Downloads the state and verifies that it is identical on all ranks.
  Status synchronise();
  // Returns kIo if the checkpoint cannot be written.
  Status save_checkpoint();
  // Describes how to resume a stopped run.
  std::string resume_hint() const;
  // Whether this is a window of a live capture, which has little time and is never resumed.
  bool is_live() const { return persistent_ != nullptr && persistent_->carries_moving(); }
  // Computes Scene::importance; kRuntime if cancelled. Before the end of the run, its progress is
  // that of the training.
  Result<std::vector<float>> importance();
  // Like save_checkpoint(), but logs a failed write as a warning, because the scene matters more.
  Status save_checkpoint_if_possible();
  // Updates the clock after a step; returns whether progress is to be reported.
  Result<bool> update_clock();
  // Returns false if the run is to stop.
  Result<bool> report_progress();
  // Returns the PSNR over the latest steps, of which none is of the first three quarters of the
  // run; 0 without steps.
  double recent_psnr() const;
  bool log_due() const;
  void write_log();
  // Evaluates the held-out views if an evaluation is due; its time does not count as training time.
  Status evaluate_held_out();
  // Evaluates into score_. Logs a warning and returns false if the views cannot be rendered.
  bool score_held_out();
  int evaluations_due() const;

  const PersistentSet* persistent_ = nullptr;  // null: not a window of a longer capture
  RecordedSpan recorded_;                      // since the set was recorded
  SceneChanges changes_;                       // of the persistent set in this window
  std::vector<int> ends_;                      // of each fixed primitive: the frame, or -1
  std::vector<std::uint32_t> stored_;          // in the set for the first time, ascending
  std::size_t fixed_ = 0;                      // primitives of the state that are fixed
  PreparedCapture capture_;
  Fingerprint image_fingerprint_;  // when the run began
  TrainSettings settings_;
  HyperParameters parameters_;
  HyperParameters growth_;  // growth_parameters()
  FreeSpace free_space_;
  Ablation ablation_;
  PerceptualTerm perceptual_;
  ProgressSink progress_;
  LogSink log_;
  Lockstep ranks_;
  TrainingImages images_;
  TrainState state_;
  std::shared_ptr<TrainBackend> backend_;
  bool is_backend_reused_ = false;  // from the previous window
  // Of a live window, by its latest pruning, which rounding uses again; empty: none.
  std::vector<float> pruned_importance_;
  StepOutput last_;  // of the latest step read
  bool step_failed_ = false;
  bool checkpoint_failed_ = false;    // the latest one
  std::uint64_t steps_read_ = 0;      // iterations, one view each, in the running mean
  std::array<double, 100> errors_{};  // mean squared, of the latest of them: a ring
  ViewOrder order_;
  std::chrono::steady_clock::time_point started_, reported_;
  StageClock clock_;
  double importance_seconds_ = 0;
  double seconds_before_ = 0;          // of the runs that this one resumes
  std::uint64_t first_iteration_ = 0;  // of this run
  LogWriter log_file_;
  HeldOutViews held_out_;
  double densified_at_ = 0;   // progress at which densification was last due, or the run began
  int evaluations_done_ = 0;  // including those before a resumed run
  std::optional<HeldOutScore> score_;
};

}  // namespace stgs::encoder
