// SPDX-License-Identifier: Apache-2.0
#include "train/trainer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "train/adam.h"
#include "train/camera_refinement.h"
#include "train/checkpoint.h"
#include "train/densify.h"
#include "train/densify_plan.h"
#include "train/foreground.h"
#include "train/free_space.h"
#include "train/random.h"
#include "train/rig.h"
#include "train/step_schedule.h"

namespace stgs::encoder {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kProgressInterval = 0.1;  // seconds
constexpr double kLossWeight = 0.02;       // of a new loss in the running mean

bool has_test_cameras(const PreparedCapture& capture) {
  return capture.training_cameras().size() < capture.cameras.size();
}

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

}  // namespace

Trainer::Trainer(const PreparedCapture& capture, const TrainSettings& settings,
                 ProgressSink progress, LogSink log)
    : capture_(capture),
      image_fingerprint_(image_fingerprint(capture)),
      settings_(settings),
      progress_(std::move(progress)),
      log_(log ? std::move(log) : [](int, const std::string&) {}),
      ranks_(settings.ranks) {}

Result<std::unique_ptr<Trainer>> Trainer::create(const PreparedCapture& capture,
                                                 const TrainSettings& settings,
                                                 const WindowState& window,
                                                 const ProgressSink& progress, const LogSink& log) {
  STGS_TRY(check_frame_files(capture, capture.cameras));
  std::unique_ptr<Trainer> trainer(new Trainer(capture, settings, progress, log));
  trainer->persistent_ = window.persistent;
  trainer->recorded_ = {window.begin, window.end};
  if (settings.foreground) {
    STGS_TRY(check_masks(capture));
    trainer->capture_.mask_background = kMaskBackground;
    trainer->image_fingerprint_ = image_fingerprint(trainer->capture_);
  }
  STGS_ASSIGN(const TrainingChoice choice, choose_training(settings));
  trainer->parameters_ = choice.parameters;
  trainer->ablation_ = choice.ablation;
  trainer->growth_ = growth_parameters(choice.parameters, settings, capture);
  if (window.backend != nullptr) trainer->backend_ = std::exchange(*window.backend, nullptr);
  trainer->is_backend_reused_ = trainer->backend_ != nullptr;
  if (!trainer->backend_) {
    STGS_ASSIGN(trainer->backend_,
                make_backend(settings.backend, settings.share.index, log, settings.ranks));
  }
  STGS_ASSIGN(trainer->perceptual_, PerceptualTerm::create(settings, choice.parameters,
                                                           *trainer->backend_, trainer->log_));
  STGS_TRY(trainer->perceptual_.check_sizes(capture.cameras));
  trainer->clock_.begin("initial state");
  STGS_TRY(trainer->prepare_state());
  STGS_TRY(trainer->prepare_ranks());
  trainer->clock_.begin("training memory");
  STGS_TRY(trainer->prepare_backend());
  trainer->clock_.begin("training images");
  STGS_TRY(trainer->load_frames());
  if (!settings.log_path.empty() && trainer->ranks_.is_first()) {
    STGS_TRY(trainer->log_file_.open(settings.log_path, trainer->state_.iteration));
  }
  return trainer;
}

Status Trainer::prepare_state() {
  STGS_TRY(prepare_priors());
  if (settings_.resume.empty()) {
    STGS_ASSIGN(state_, initial_state(capture_, growth_, ablation_, settings_.seed, persistent_,
                                      &changes_));
  } else {
    STGS_TRY(resume());
  }
  if (settings_.held_out_evaluations > 0 && ranks_.is_first()) {
    Result<HeldOutViews> held_out = HeldOutViews::load(capture_);
    if (held_out.ok()) {
      held_out_ = std::move(*held_out);
      if (held_out_.empty() && settings_.foreground && has_test_cameras(capture_))
        log_(1, "held-out views will not be evaluated: the test cameras have no masks");
    } else {
      log_(1, fmt::format("held-out views will not be evaluated: {}", held_out.status().message()));
    }
  }
  if (ablation_.densification == Densification::kRelocation &&
      state_.size() < static_cast<std::size_t>(growth_.max_primitives)) {
    log_(1, fmt::format("relocation adds no primitives: there are {} of at most {}, because {} has "
                        "no more initial points",
                        state_.size(), growth_.max_primitives, capture_.folder));
  }
  fixed_ = state_.count_fixed();
  ends_ = ends_of_fixed(state_, changes_);
  STGS_TRY(prepare_cameras());
  evaluations_done_ = evaluations_due();
  return {};
}

// Checks that all ranks have the same inputs, and logs how iterations map to steps.
Status Trainer::prepare_ranks() {
  settings_.checkpoint_interval = std::max(settings_.checkpoint_interval, 1);
  if (ranks_.ranks() == nullptr) return {};
  STGS_TRY(ranks_.check_same_text(fingerprint_text(settings_fingerprint()),
                                  "capture or other settings"));
  STGS_TRY(ranks_.check_same_text(
      fmt::format("{} {} {} {}", !settings_.checkpoint.empty(), settings_.checkpoint_interval,
                  !settings_.log_path.empty(), settings_.held_out_evaluations),
      "checkpoint, log or evaluation settings"));
  STGS_TRY(ranks_.check_same_text(fmt::format("{:016x}", state_hash(state_)), "initial state"));
  const auto steps = (static_cast<std::uint64_t>(parameters_.iterations) + ranks_.size() - 1) /
                     static_cast<std::uint64_t>(ranks_.size());
  log_(2,
       fmt::format("{} processes train one view each per step: {} iterations (views) take {} steps",
                   ranks_.size(), parameters_.iterations, steps));
  return {};
}

Status Trainer::prepare_backend() {
  log_(2, fmt::format("training on {}", backend_->name()));
  TrainPlan plan = train_plan({growth_, ablation_}, perceptual_, capture_.cameras);
  plan.primitives += state_.count_fixed();
  const Status reserved = backend_->reserve(plan);
  if (reserved.ok() || !is_backend_reused_) return reserved;
  // With the memory of the previous window, there may be too little for a larger one.
  backend_.reset();
  STGS_ASSIGN(backend_,
              make_backend(settings_.backend, settings_.share.index, log_, settings_.ranks));
  return backend_->reserve(plan);
}

// Called last, because it takes longest.
Status Trainer::load_frames() {
  const int processes = std::max(ranks_.node_size(), settings_.share.processes);
  STGS_ASSIGN(images_,
              TrainingImages::load(capture_, settings_.frame_memory, processes, progress_));
  order_ = ViewOrder(settings_.seed, images_.views());
  use_cameras();
  const FrameStatistics frames = images_.statistics();
  constexpr double kMib = 1 << 20;
  log_(2, frames.resident
              ? fmt::format("all {} frames are in memory, {:.0f} MiB", images_.views(),
                            static_cast<double>(frames.peak) / kMib)
              : fmt::format("{} frames are read from disk, with a cache of {:.0f} MiB",
                            images_.views(), static_cast<double>(frames.budget) / kMib));
  return {};
}

double Trainer::run_progress() const {
  return progress_at(state_.iteration);
}

// An estimate for later iterations, because their time is not known.
double Trainer::progress_at(std::uint64_t iteration) const {
  const double by_iteration =
      static_cast<double>(iteration) / static_cast<double>(parameters_.iterations);
  if (settings_.max_seconds <= 0) return std::min(1.0, by_iteration);
  return std::min(1.0, std::max(by_iteration, state_.seconds / settings_.max_seconds));
}

double Trainer::growth_progress_at(std::uint64_t iteration) const {
  return std::min(1.0, progress_at(iteration) / (1.0 - parameters_.compact_share));
}

// The level is that of the step that begins at `iteration`, identical on all ranks.
TrainingView Trainer::view_at(std::uint64_t iteration, int rank) {
  TrainingView view = images_.view(order_.at(iteration + static_cast<std::uint64_t>(rank)));
  view.level = growth_progress_at(iteration) < parameters_.coarse_until ? 1 : 0;
  return view;
}

std::vector<BatchView> Trainer::batch_views() {
  std::vector<BatchView> views;
  for (int r = 0; r < ranks_.size(); ++r) {
    const auto [camera, frame, level] = view_at(state_.iteration, r);
    const math::PinholeCamera pinhole = images_.pinhole(camera, level, capture_.near_plane);
    views.push_back({math::camera_centre(pinhole), ticks_of(camera, frame), camera});
  }
  return views;
}

Result<StepInput> Trainer::step_input() {
  const HyperParameters& p = parameters_;
  const double progress = growth_progress();
  // Index of this rank's view in the run.
  const std::uint64_t view_index = state_.iteration + static_cast<std::uint64_t>(ranks_.rank());
  const auto [camera, frame, level] = view_at(state_.iteration, ranks_.rank());
  StepInput input;
  input.camera = images_.pinhole(camera, level, capture_.near_plane);
  input.ticks = ticks_of(camera, frame);
  STGS_ASSIGN(input.ground_truth, images_.next([this](std::uint64_t k) {
    return view_at(state_.iteration + k * static_cast<std::uint64_t>(ranks_.size()), ranks_.rank());
  }));
  input.colour_index = camera;
  input.background = state_.background;
  if (settings_.foreground) {
    input.background =
        mask_background_of(camera * static_cast<std::size_t>(capture_.frames) + frame);
    input.background_is_mapped = true;
  }
  input.drop_share = static_cast<float>(p.drop_share);
  input.drop_random = Random(settings_.seed, view_index, RandomPurpose::kDrop);
  input.modulated = ablation_.modulation;
  input.learn_radius = ablation_.lifespan;
  const DensifyPlan plan = densify_plan(p, ablation_, progress, false);
  input.second_stage = plan.second_stage || state_.second_stage != 0;
  input.gather_camera = refines_cameras();
  if (!state_.cameras.empty()) input.lens = lens_of(state_.cameras[camera]);
  // The colour outside the masks has no vignetting.
  if (settings_.foreground) input.lens.vignetting = 0;
  input.gather_statistics = plan.gather;
  set_schedule(p, capture_, progress, state_.is_coupled(), input);
  if (fixed_ > 0) input.sh_degree = p.sh_degree;  // fixed primitives have all of theirs
  if (with_normals() && progress >= p.normal_from)
    input.weight_normal = static_cast<float>(growth_.weight_normal);
  if (state_.compaction.prunings > 0) set_compaction_schedule(input);
  perceptual_.apply(settings_.seed, view_index, progress, input);
  if (ranks_.ranks() != nullptr) {
    input.batch = batch_views();
    set_batch_schedule(p, ranks_.size(), input);
  }
  return input;
}

Status Trainer::read_steps() {
  const Result<std::vector<StepOutput>> outputs = backend_->read();
  if (!outputs.ok()) return on_step_failed(outputs.status());
  for (const StepOutput& output : *outputs) {
    ++steps_read_;
    state_.mean_loss += (output.loss - state_.mean_loss) * (steps_read_ == 1 ? 1.0 : kLossWeight);
    if (!std::isfinite(output.loss)) {
      return runtime_error("training diverged at iteration {}: the loss is not finite",
                           steps_read_);
    }
    last_ = output;
    errors_[steps_read_ % errors_.size()] = output.mse;
    if (output.camera) {
      const math::Vec3 r = output.camera->rotation, t = output.camera->translation;
      if (!std::isfinite(r.x + r.y + r.z + t.x + t.y + t.z + output.camera->log_focal +
                         output.camera->distortion + output.vignetting + output.camera->time)) {
        return runtime_error(
            "training diverged at iteration {}: the gradient of a camera is not "
            "finite; train without --refine-cameras and --refine-timing",
            steps_read_);
      }
      const std::size_t camera = images_.view(order_.at(steps_read_ - 1)).camera;
      add_camera_gradient(state_, camera, *output.camera,
                          settings_.foreground ? 0.0f : output.vignetting);
    }
  }
  return {};
}

bool Trainer::densify_due() {
  const double now = growth_progress();
  // A run with a time limit may end before it reaches an interval.
  const bool late = settings_.max_seconds > 0 && now - densified_at_ >= 1.0 / kMinDensifySteps;
  if (!late && !passed(static_cast<std::uint64_t>(parameters_.densify_interval))) return false;
  densified_at_ = now;
  return true;
}

Status Trainer::densify() {
  const DensifyPlan plan = densify_plan(parameters_, ablation_, growth_progress(), densify_due());
  if (plan.second_stage) state_.second_stage = 1;
  if (!plan.grow && !plan.replace && !plan.relocate) return {};
  STGS_TRY(read_steps());
  const DensifyContext context{
      capture_.extent, ablation_.modulation, ablation_.densification == Densification::kPlain,
      settings_.seed,  free_space_,          vicinity_of(capture_)};
  const bool reset = plan.grow && static_cast<int>(state_.opacity_resets) < plan.resets_due;
  const DensifyStep step = plan.grow      ? DensifyStep::kGrow
                           : plan.replace ? DensifyStep::kReplace
                                          : DensifyStep::kRelocate;
  STGS_ASSIGN(const DensifyCounts counts, backend_->densify({&growth_, context, step, reset}));
  if (reset) ++state_.opacity_resets;
  if (counts.non_finite > 0) {
    log_(1, fmt::format("iteration {}: removed or replaced {} primitive{} with non-finite values",
                        state_.iteration, counts.non_finite, counts.non_finite == 1 ? "" : "s"));
  }
  log_(3, fmt::format("iteration {}: {} primitives; {} cloned, {} split, {} removed, {} replaced",
                      state_.iteration, backend_->size(), counts.cloned, counts.split,
                      counts.removed, counts.replaced));
  return {};
}

Status Trainer::synchronise() {
  STGS_TRY(read_steps());
  STGS_TRY(backend_->synchronise());
  return ranks_.ranks() == nullptr ? Status() : ranks_.check_same_state(state_hash(state_));
}

Result<bool> Trainer::update_clock() {
  Lockstep::ClockState clock{seconds_before_ + seconds_since(started_),
                             seconds_since(reported_) >= kProgressInterval};
  STGS_ASSIGN(clock, ranks_.sync_clock(clock));
  state_.seconds = clock.seconds;
  return clock.is_progress_due || finished();
}

Status Trainer::step() {
  Result<StepInput> input = step_input();
  const Status stepped = input.ok() ? backend_->step(*input) : input.status();
  if (!stepped.ok()) return on_step_failed(stepped);
  state_.iteration += static_cast<std::uint64_t>(ranks_.size());
  return {};
}

Status Trainer::on_step_failed(const Status& error) {
  step_failed_ = true;
  return error;
}

Status Trainer::run() {
  const Status trained = train();
  return step_failed_ ? save_completed_steps(trained) : trained;
}

Status Trainer::train() {
  started_ = Clock::now();
  steps_read_ = state_.iteration;
  // A window without moving content adds nothing to the persistent set.
  if (persistent_ != nullptr && fixed_ == state_.size()) return {};
  densified_at_ = growth_progress();
  clock_.begin("training steps");
  STGS_TRY(backend_->begin(state_));
  // A run that was already complete has its latest evaluation only in the log.
  if (finished() && !held_out_.empty()) (void)score_held_out();
  STGS_TRY(compact());  // that a cancelled run did not complete
  while (!finished()) {
    STGS_TRY(step());
    STGS_ASSIGN(const bool progress_due, update_clock());
    STGS_TRY(update_cameras());
    STGS_TRY(limit_scales());
    STGS_TRY(densify());
    STGS_TRY(compact());
    const bool checkpoint = passed(static_cast<std::uint64_t>(settings_.checkpoint_interval));
    const bool progress = checkpoint || progress_due;
    if (progress || log_due()) STGS_TRY(read_steps());
    if (log_due() && ranks_.is_first()) write_log();
    STGS_TRY(evaluate_held_out());
    if (checkpoint && !finished()) STGS_TRY(save_checkpoint_if_possible());
    if (!progress) continue;
    STGS_ASSIGN(const bool should_continue, report_progress());
    if (!should_continue) {
      STGS_TRY(save_checkpoint());
      return runtime_error("stopped at iteration {}; {}", state_.iteration, resume_hint());
    }
  }
  STGS_TRY(synchronise());
  STGS_TRY(save_checkpoint_if_possible());
  // After the checkpoint, for which the state was downloaded from the backend again.
  if (state_.compaction.is_rounding()) state_.set = rounded_set(state_);
  const std::size_t non_finite = remove_non_finite(state_);
  if (state_.size() == 0 && persistent_ == nullptr) {
    return runtime_error(
        "training left no primitives: {}; no scene is written",
        non_finite > 0 ? fmt::format("all {} have non-finite values", non_finite)
                       : "all were pruned as too faint (prune_opacity) or too large (prune_scale)");
  }
  if (non_finite > 0) {
    log_(1, fmt::format("removed {} primitive{} with non-finite values", non_finite,
                        non_finite == 1 ? "" : "s"));
  }
  if (const Status written = log_file_.check(); !written.ok()) log_(1, written.message());
  if (ranks_.is_first()) report_cameras();
  return {};
}

}  // namespace stgs::encoder
