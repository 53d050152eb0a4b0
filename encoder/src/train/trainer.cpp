// SPDX-License-Identifier: Apache-2.0
#include "train/trainer.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "train/adam.h"
#include "train/checkpoint.h"
#include "train/densify.h"
#include "train/densify_plan.h"
#include "train/random.h"
#include "train/step_schedule.h"

namespace stgs::encoder {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kProgressInterval = 0.1;   // seconds
constexpr std::uint64_t kLogInterval = 50;  // iterations
constexpr double kLossMemory = 0.02;        // of the running mean, a step

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

}  // namespace

Trainer::Trainer(const PreparedCapture& capture, const TrainSettings& settings,
                 ProgressSink progress, LogSink log)
    : capture_(capture),
      pictures_(image_fingerprint(capture)),
      settings_(settings),
      progress_(std::move(progress)),
      log_(log ? std::move(log) : [](int, const std::string&) {}),
      ranks_(settings.ranks) {}

Result<std::unique_ptr<Trainer>> Trainer::create(const PreparedCapture& capture,
                                                 const TrainSettings& settings,
                                                 const ProgressSink& progress, const LogSink& log) {
  std::unique_ptr<Trainer> trainer(new Trainer(capture, settings, progress, log));
  STGS_ASSIGN(const TrainingChoice choice, choose_training(settings));
  trainer->parameters_ = choice.parameters;
  trainer->ablation_ = choice.ablation;
  STGS_ASSIGN(trainer->backend_, make_backend(settings.backend, log, settings.ranks));
  STGS_ASSIGN(trainer->perceptual_, PerceptualTerm::create(settings, choice.parameters,
                                                           *trainer->backend_, trainer->log_));
  STGS_TRY(trainer->perceptual_.check_sizes(capture.cameras));
  STGS_TRY(trainer->prepare_state());
  STGS_TRY(trainer->prepare_ranks());
  STGS_TRY(trainer->prepare_backend());
  STGS_TRY(trainer->load_frames());
  if (!settings.log_path.empty() && trainer->ranks_.first()) {
    STGS_TRY(trainer->log_file_.open(settings.log_path, trainer->state_.iteration));
  }
  return trainer;
}

Status Trainer::prepare_state() {
  if (settings_.resume.empty()) {
    STGS_ASSIGN(state_, initial_state(capture_, parameters_, ablation_, settings_.seed));
  } else {
    STGS_TRY(resume());
  }
  if (settings_.held_out_evaluations > 0 && ranks_.first()) {
    Result<HeldOutViews> held_out = HeldOutViews::load(capture_);
    if (held_out.ok()) {
      held_out_ = std::move(*held_out);
    } else {
      log_(1, fmt::format("held-out views will not be measured: {}", held_out.status().message()));
    }
  }
  measured_ = measures_due();
  return {};
}

Status Trainer::resume() {
  STGS_ASSIGN(Checkpoint checkpoint, read_checkpoint(settings_.resume));
  STGS_TRY(check_same_run(settings_.resume, checkpoint.fingerprint, fingerprint()));
  const std::string before = value_of(checkpoint.fingerprint, kBackendEntry);
  if (before != backend_->name()) {
    log_(1, fmt::format("{}: was made on {} and goes on on {}: to a scene as good, not to the same "
                        "bits as an unbroken run",
                        settings_.resume, before, backend_->name()));
  }
  const std::string processes = value_of(checkpoint.fingerprint, kProcessesEntry);
  if (processes != fmt::format("{}", ranks_.size())) {
    log_(1, fmt::format("{}: {} process(es) made it and {} go(es) on: to a scene as good, not to "
                        "the same bits as an unbroken run",
                        settings_.resume, processes, ranks_.size()));
  }
  state_ = std::move(checkpoint.state);
  seconds_before_ = state_.seconds;
  first_iteration_ = state_.iteration;
  log_(2, fmt::format("resumed at iteration {} from {}", state_.iteration, settings_.resume));
  return {};
}

// What all ranks must have alike, and what a person should know of there being several.
Status Trainer::prepare_ranks() {
  settings_.checkpoint_interval = std::max(settings_.checkpoint_interval, 1);
  if (ranks_.ranks() == nullptr) return {};
  STGS_TRY(ranks_.same_text(fingerprint_text(settings_fingerprint()), "capture or other settings"));
  STGS_TRY(ranks_.same_text(
      fmt::format("{} {} {} {}", !settings_.checkpoint.empty(), settings_.checkpoint_interval,
                  !settings_.log_path.empty(), settings_.held_out_evaluations),
      "checkpoint, log or measures"));
  STGS_TRY(ranks_.same_text(fmt::format("{:016x}", state_hash(state_)), "start"));
  const auto steps = (static_cast<std::uint64_t>(parameters_.iterations) + ranks_.size() - 1) /
                     static_cast<std::uint64_t>(ranks_.size());
  log_(2, fmt::format("{} processes, a view each in every step: the {} iterations are views, which "
                      "makes {} steps",
                      ranks_.size(), parameters_.iterations, steps));
  return {};
}

Status Trainer::prepare_backend() {
  log_(2, fmt::format("training on {}", backend_->name()));
  return backend_->reserve(train_plan({parameters_, ablation_}, perceptual_, capture_.cameras));
}

// Last, since it takes longest.
Status Trainer::load_frames() {
  STGS_ASSIGN(images_, TrainingImages::load(capture_, settings_.frame_memory, ranks_.node_size(),
                                            progress_));
  order_ = ViewOrder(settings_.seed, images_.views());
  const FrameStatistics frames = images_.statistics();
  constexpr double kMib = 1 << 20;
  log_(2, frames.resident
              ? fmt::format("{} frames are in memory, {:.0f} MiB", images_.views(),
                            static_cast<double>(frames.peak) / kMib)
              : fmt::format("{} frames come from disk, {:.0f} MiB of them are kept",
                            images_.views(), static_cast<double>(frames.budget) / kMib));
  return {};
}

// What is the same on all ranks, whose pictures may be copies of each other's.
Fingerprint Trainer::settings_fingerprint() const {
  Fingerprint all = fingerprint_of(parameters_, settings_);
  const Fingerprint capture = fingerprint_of(capture_);
  all.insert(all.end(), capture.begin(), capture.end());
  all.emplace_back("perceptual weights", perceptual_.fingerprint());
  all.emplace_back(kProcessesEntry, fmt::format("{}", ranks_.size()));
  return all;
}

Fingerprint Trainer::fingerprint() const {
  Fingerprint all = settings_fingerprint();
  all.insert(all.end(), pictures_.begin(), pictures_.end());
  all.emplace_back(kBackendEntry, backend_->name());
  return all;
}

double Trainer::share() const {
  return share_at(state_.iteration);
}

// As far as is known now: the time that it will take is not.
double Trainer::share_at(std::uint64_t iteration) const {
  const double by_iteration =
      static_cast<double>(iteration) / static_cast<double>(parameters_.iterations);
  if (settings_.max_seconds <= 0) return std::min(1.0, by_iteration);
  return std::min(1.0, std::max(by_iteration, state_.seconds / settings_.max_seconds));
}

// Its level is that of the step which begins at `iteration`, alike for all ranks.
TrainingView Trainer::view_at(std::uint64_t iteration, int rank) {
  const std::size_t view = order_.at(iteration + static_cast<std::uint64_t>(rank));
  const std::size_t frames = static_cast<std::size_t>(capture_.frames);
  const int level = share_at(iteration) < parameters_.coarse_until ? 1 : 0;
  return {view / frames, static_cast<int>(view % frames), level};
}

std::vector<BatchView> Trainer::batch_views() {
  std::vector<BatchView> views;
  for (int r = 0; r < ranks_.size(); ++r) {
    const auto [camera, frame, level] = view_at(state_.iteration, r);
    const math::PinholeCamera pinhole = images_.pinhole(camera, level, capture_.near_plane);
    views.push_back({math::camera_centre(pinhole), static_cast<float>(frame), camera});
  }
  return views;
}

Result<StepInput> Trainer::step_input() {
  const HyperParameters& p = parameters_;
  const double done = share();
  // Of the run's views, this rank's.
  const std::uint64_t image = state_.iteration + static_cast<std::uint64_t>(ranks_.rank());
  const auto [camera, frame, level] = view_at(state_.iteration, ranks_.rank());
  StepInput input;
  input.camera = images_.pinhole(camera, level, capture_.near_plane);
  input.ticks = static_cast<float>(frame);
  STGS_ASSIGN(input.ground_truth, images_.next([this](std::uint64_t k) {
    return view_at(state_.iteration + k * static_cast<std::uint64_t>(ranks_.size()), ranks_.rank());
  }));
  input.colour_index = camera;
  input.background = state_.background;
  input.drop_share = static_cast<float>(p.drop_share);
  input.drop_random = Random(settings_.seed, image, RandomPurpose::kDrop);
  input.modulated = ablation_.modulation;
  input.learn_radius = ablation_.lifespan;
  input.second_stage = state_.second_stage != 0;
  input.gather_statistics = densify_plan(p, ablation_, done, false).gather;
  set_schedule(p, capture_, done, state_.is_coupled(), input);
  if (with_normals() && done >= p.normal_from)
    input.weight_normal = static_cast<float>(p.weight_normal);
  perceptual_.apply(settings_.seed, image, done, input);
  if (ranks_.ranks() != nullptr) {
    input.batch = batch_views();
    set_batch_schedule(p, ranks_.size(), input);
  }
  return input;
}

Status Trainer::read_steps() {
  const Result<std::vector<StepOutput>> outputs = backend_->read();
  if (!outputs.ok()) return undone(outputs.status());
  for (const StepOutput& output : *outputs) {
    ++steps_read_;
    state_.mean_loss += (output.loss - state_.mean_loss) * (steps_read_ == 1 ? 1.0 : kLossMemory);
    if (!std::isfinite(output.loss)) {
      return runtime_error("training diverged at iteration {}: the loss is not a number",
                           steps_read_);
    }
    last_ = output;
  }
  return {};
}

bool Trainer::densify_due() {
  const double now = share();
  // A run with a time limit may be over before it comes to an interval.
  const bool late = settings_.max_seconds > 0 && now - densified_ >= 1.0 / kLeastMoments;
  if (!late && !passed(static_cast<std::uint64_t>(parameters_.densify_interval))) return false;
  densified_ = now;
  return true;
}

Status Trainer::densify() {
  const DensifyPlan plan = densify_plan(parameters_, ablation_, share(), densify_due());
  if (plan.second_stage) state_.second_stage = 1;
  if (!plan.grow && !plan.replace) return {};
  STGS_TRY(read_steps());
  const DensifyContext context{capture_.extent, ablation_.modulation, !ablation_.densification,
                               settings_.seed};
  const bool reset = plan.grow && static_cast<int>(state_.opacity_resets) < plan.resets_due;
  STGS_ASSIGN(const DensifyCounts counts,
              backend_->densify({&parameters_, context, plan.replace, reset}));
  if (reset) ++state_.opacity_resets;
  if (counts.non_finite > 0) {
    log_(1,
         fmt::format("iteration {}: {} primitives had values that are not numbers and were removed",
                     state_.iteration, counts.non_finite));
  }
  log_(3, fmt::format("iteration {}: {} primitives; {} cloned, {} split, {} removed, {} replaced",
                      state_.iteration, backend_->size(), counts.cloned, counts.split,
                      counts.removed, counts.replaced));
  return {};
}

Status Trainer::synchronise() {
  STGS_TRY(read_steps());
  STGS_TRY(backend_->synchronise());
  return ranks_.ranks() == nullptr ? Status() : ranks_.same_state(state_hash(state_));
}

Status Trainer::save_checkpoint() {
  if (settings_.checkpoint.empty()) return {};
  STGS_TRY(synchronise());
  return ranks_.first() ? write_checkpoint(settings_.checkpoint, state_, fingerprint()) : Status();
}

Status Trainer::save_checkpoint_if_possible() {
  if (settings_.checkpoint.empty()) return {};
  STGS_TRY(synchronise());
  if (!ranks_.first()) return {};
  const Status written = write_checkpoint(settings_.checkpoint, state_, fingerprint());
  // A full disk stays full: its first checkpoint and that of the end are told.
  if (!written.ok() && (!checkpoint_failed_ || finished())) {
    log_(1, fmt::format("iteration {}: {}, and its checkpoint is not written: {}", state_.iteration,
                        finished() ? "training is done" : "training goes on", written.message()));
  }
  checkpoint_failed_ = !written.ok();
  return {};
}

Result<bool> Trainer::tick() {
  Lockstep::Moment moment{seconds_before_ + seconds_since(started_),
                          seconds_since(reported_) >= kProgressInterval};
  STGS_ASSIGN(moment, ranks_.moment(moment));
  state_.seconds = moment.seconds;
  return moment.progress || finished();
}

Result<bool> Trainer::report_progress() {
  reported_ = Clock::now();
  if (!progress_) {
    STGS_ASSIGN(const bool stop, ranks_.any(false));
    return !stop;
  }
  const double done = share();
  const double eta = done > 0 ? state_.seconds * (1.0 - done) / done : -1;
  std::string detail = fmt::format("iteration {}, loss {:.4f}, {} primitives", state_.iteration,
                                   state_.mean_loss, backend_->size());
  if (score_) detail += fmt::format(", held-out psnr {:.2f} dB", score_->psnr);
  TrainProgress training{state_.iteration, static_cast<std::uint64_t>(parameters_.iterations),
                         state_.mean_loss, backend_->size(), std::nullopt};
  if (score_) training.held_out_psnr = score_->psnr;
  STGS_ASSIGN(const bool stop, ranks_.any(!progress_({"train", done, eta, detail, training})));
  return !stop;
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

int Trainer::measures_due() const {
  return static_cast<int>(share() * settings_.held_out_evaluations);
}

Status Trainer::measure_held_out() {
  // Where several train, the first measures and all bring their states along.
  const bool measures = ranks_.size() > 1 ? settings_.held_out_evaluations > 0 : !held_out_.empty();
  if (!measures || measures_due() == measured_) return {};
  measured_ = measures_due();
  STGS_TRY(read_steps());
  const Clock::time_point begin = Clock::now();
  STGS_TRY(backend_->synchronise());
  if (held_out_.empty()) return {};
  if (measure_held_out_now()) {
    log_file_.write(LoggedEvaluation{state_.iteration, state_.seconds, *score_});
  }
  started_ += Clock::now() - begin;
  return {};
}

bool Trainer::measure_held_out_now() {
  try {
    score_ = held_out_.measure(state_.set, state_.background);
    return true;
  } catch (const std::length_error& error) {
    log_(1, fmt::format("iteration {}: held-out views could not be drawn: {}", state_.iteration,
                        error.what()));
    return false;
  }
}

Status Trainer::step() {
  Result<StepInput> input = step_input();
  const Status stepped = input.ok() ? backend_->step(*input) : input.status();
  if (!stepped.ok()) return undone(stepped);
  state_.iteration += static_cast<std::uint64_t>(ranks_.size());
  return {};
}

Status Trainer::undone(const Status& error) {
  steps_undone_ = true;
  return error;
}

Status Trainer::keep_trained(const Status& error) {
  steps_undone_ = false;
  if (ranks_.ranks() != nullptr || settings_.checkpoint.empty()) return error;
  state_.iteration -= backend_->abandon();
  state_.second_stage = densify_plan(parameters_, ablation_, share(), false).second_stage ? 1 : 0;
  const Status saved = save_checkpoint();
  if (!saved.ok()) {
    log_(1, saved.message());
    return error;
  }
  return Status(error.code(), fmt::format("{}; {} iterations are done: go on with --resume {}",
                                          error.message(), state_.iteration, settings_.checkpoint));
}

std::string Trainer::how_to_go_on() const {
  // Of a run that was at its end there is nothing more to keep than it came from.
  const bool as_it_came = !settings_.resume.empty() && state_.iteration == first_iteration_;
  const std::string& from =
      settings_.checkpoint.empty() && as_it_came ? settings_.resume : settings_.checkpoint;
  return from.empty() ? "no checkpoint was asked for" : fmt::format("go on with --resume {}", from);
}

Status Trainer::run() {
  const Status trained = train();
  return steps_undone_ ? keep_trained(trained) : trained;
}

Status Trainer::train() {
  started_ = Clock::now();
  steps_read_ = state_.iteration;
  densified_ = share();
  STGS_TRY(backend_->begin(state_));
  // A run that had ended before has its last measure in the log, and nowhere else.
  if (finished() && !held_out_.empty()) (void)measure_held_out_now();
  while (!finished()) {
    STGS_TRY(step());
    STGS_ASSIGN(const bool progress_due, tick());
    STGS_TRY(densify());
    const bool checkpoint = passed(static_cast<std::uint64_t>(settings_.checkpoint_interval));
    const bool progress = checkpoint || progress_due;
    if (progress || log_due()) STGS_TRY(read_steps());
    if (log_due() && ranks_.first()) write_log();
    STGS_TRY(measure_held_out());
    if (checkpoint && !finished()) STGS_TRY(save_checkpoint_if_possible());
    if (!progress) continue;
    STGS_ASSIGN(const bool go_on, report_progress());
    if (!go_on) {
      STGS_TRY(save_checkpoint());
      return runtime_error("stopped at iteration {}; {}", state_.iteration, how_to_go_on());
    }
  }
  STGS_TRY(synchronise());
  STGS_TRY(save_checkpoint_if_possible());
  // After the checkpoint, which takes the state from the backend once more.
  const std::size_t broken = remove_non_finite(state_);
  if (state_.size() == 0) {
    return runtime_error(
        "training left nothing: {}; no scene is written",
        broken > 0 ? fmt::format("all {} primitives have values that are not numbers", broken)
                   : "every primitive was removed as too faint (prune_opacity) or too large");
  }
  if (broken > 0) {
    log_(1, fmt::format("{} primitives had values that are not numbers and were left out", broken));
  }
  if (const Status written = log_file_.check(); !written.ok()) log_(1, written.message());
  return {};
}

}  // namespace stgs::encoder
