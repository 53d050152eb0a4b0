// SPDX-License-Identifier: Apache-2.0
#include "stream/window_trainer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "stgs/encoder/windows.h"
#include "stgs/format/byte_source.h"
#include "train/training_choice.h"

namespace stgs::encoder {
namespace {

constexpr std::uint64_t kMaxIdentityBytes = 1u << 20;

Result<std::string> read_text(const std::string& path) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> file, open_file(path));
  if (file->size() > kMaxIdentityBytes) return invalid_file("{}: damaged (too long)", path);
  std::string text(file->size(), '\0');
  STGS_TRY(file->read(0, {reinterpret_cast<std::uint8_t*>(text.data()), text.size()}));
  return text;
}

// kUsage for settings with which windows cannot share content or be recorded.
Status check_settings(const StreamSettings& settings, const TrainingChoice& choice) {
  const Ablation& ablation = choice.ablation;
  if (!ablation.representation || !ablation.initialisation) {
    return usage_error(
        "windows share the static primitives of the method sharptimegs; encode all frames at once "
        "with this method or ablation (--window 0)");
  }
  if (settings.resumable && settings.carries_moving)
    return usage_error(
        "a run that carries moving content cannot be resumable; set resumable to false");
  if (settings.pack.profile == Profile::kNearLossless) {
    return usage_error(
        "windows cannot be written in the profile {}, whose errors are known only at the end; "
        "encode all frames at once (--window 0), or use the profile {}",
        profile_name(settings.pack.profile), profile_name(Profile::kQuantised));
  }
  return {};
}

}  // namespace

std::string set_path_of(const std::string& folder, int frames) {
  return fmt::format("{}/persistent-{:07}.set", folder, frames);
}

std::string identity_path_of(const std::string& folder) {
  return folder + "/identity.txt";
}

Result<WindowTrainer> WindowTrainer::create(const StreamSettings& settings) {
  STGS_TRY(check_training(settings.train, nullptr));
  STGS_TRY(check_packing(settings.pack));
  STGS_ASSIGN(const TrainingChoice choice, choose_training(settings.train));
  STGS_TRY(check_settings(settings, choice));
  STGS_ASSIGN(const std::uint64_t training, settings_id(settings.train));
  WindowTrainer trainer(settings.train);
  trainer.identity_ = fmt::format("stgs {}\ntraining {:016x}\nseed {}\n{}", STGS_VERSION, training,
                                  settings.train.seed, settings.identity);
  trainer.later_iterations_ = std::max(
      1, static_cast<int>(std::lround(settings.later_share * choice.parameters.iterations)));
  return trainer;
}

Result<bool> WindowTrainer::is_run_of(const std::string& folder) const {
  STGS_ASSIGN(const std::string found, read_text(identity_path_of(folder)));
  return found == identity_;
}

void WindowTrainer::take_bounds(const PreparedCapture& first) {
  bounds_ = {first.near_plane, first.extent, first.scene_radius};
  std::copy_n(first.scene_centre, 3, bounds_->centre);
}

TrainSettings WindowTrainer::settings_for(int frames, const WindowWork& work) const {
  TrainSettings settings = settings_;
  if (work.max_seconds > 0) settings.max_seconds = work.max_seconds;
  if (work.keep > 0)
    settings.overrides.emplace_back("compact_keep", fmt::format("{:.6f}", work.keep));
  if (frames > 0 || work.iterations > 0) {
    settings.iterations = work.iterations > 0 ? work.iterations : later_iterations_;
    std::erase_if(settings.overrides,
                  [](const auto& entry) { return entry.first == "iterations"; });
  }
  return settings;
}

Result<TrainedWindow> WindowTrainer::train(PreparedCapture window, const PersistentSet& set,
                                           FrameSpan frames, const ProgressSink& progress,
                                           const LogSink& log, const WindowWork& work) {
  window.near_plane = bounds_->near_plane;
  window.extent = bounds_->extent;
  window.scene_radius = bounds_->radius;
  std::copy_n(bounds_->centre, 3, window.scene_centre);
  TrainedWindow out;
  out.set = set;
  STGS_ASSIGN(out.scene,
              encoder::train(window, settings_for(frames.begin, work), progress, log, &out.training,
                             {&out.set, &backend_, window.time_base.seconds(frames.begin),
                              window.time_base.seconds(frames.end)}));
  return out;
}

}  // namespace stgs::encoder
