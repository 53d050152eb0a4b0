// SPDX-License-Identifier: Apache-2.0
#include "encode_options.h"

#include <filesystem>

#include "options.h"
#include "output_path.h"
#include "train_report.h"
#include "usage.h"

namespace stgs::tools {

void TrainOptions::declare(Arguments& app) {
  const char* group = "Training";
  with_choices(app.add_option("--preset", preset_, "Training preset: fast, default or best"),
               {"fast", "default", "best"})
      ->capture_default_str()
      ->group(group);
  app.add_option("--iterations", iterations_,
                 "Training views, one per step and process (default: from the preset)")
      ->check(number_between(1, 1e8))
      ->group(group);
  app.add_option("--max-primitives", max_primitives_,
                 "Maximum number of primitives (default: from the preset)")
      ->check(number_between(1, 2e8))
      ->group(group);
  app.add_option("--max-seconds", max_seconds_, "Time limit in seconds; the schedule adapts to it")
      ->check(number_between(1, 1e8))
      ->group(group);
  app.add_option(
         "--frame-memory", frame_memory_,
         "Memory for decoded frames, for example 512M or 8G (default: a share of the free memory). "
         "Frames that do not fit are decoded again when needed. Frames in use by steps in flight "
         "and by decoding threads are extra")
      ->group(group);
  app.add_option(
         "--resume", resume_,
         "Checkpoint to resume from; bit-exact on the same kind of CPU or GPU, with a warning "
         "on another backend")
      ->group(group);
  auto* checkpoint =
      app.add_option("--checkpoint", checkpoint_,
                     "Write checkpoints to this file, periodically and when interrupted")
          ->group(group);
  app.add_option("--checkpoint-interval", checkpoint_interval_, "Steps between checkpoints")
      ->check(number_between(1, 1e8))
      ->capture_default_str()
      ->needs(checkpoint)
      ->group(group);
  with_choices(
      app.add_option(
          "--ablate", ablate_,
          "Disable parts of the method, comma-separated: representation (use the coupled one "
          "of 4DGS), lifespan (r = 0), modulation (f = 1; with --set velocity_shrink=0 the "
          "motion of FreeTimeGS), initialisation (points of the first frame only, all static, "
          "v = 0), densification (as in 3DGS and 4DGS)"),
      encoder::ablation_names())
      ->delimiter(',')
      ->allow_extra_args(false)
      ->group(group);
  app.add_option("--set", overrides_,
                 "Set a hyper-parameter, KEY=VALUE; repeatable (see --list-parameters)")
      ->allow_extra_args(false)
      ->group(group);
  app.add_option("--perceptual-weights", perceptual_weights_,
                 "Safetensors file of VGG16 weights; enables the perceptual loss")
      ->group(group);
  app.add_option("--log", log_, "Write steps and evaluations to this file, as JSON lines")
      ->group(group);
  app.add_option("--title", title_, "Metadata: title of the scene, shown by players and info")
      ->group(group);
  app.add_option("--report", report_,
                 "Write a report to this folder: curves, test renders and statistics (index.html)")
      ->group(group);
  app.add_option(
         "--num-evals", num_evals_,
         "Number of evaluations on a sample of the held-out cameras during training; 0: none")
      ->check(number_between(0, 1e6))
      ->capture_default_str()
      ->group(group);
}

Status TrainOptions::check_paths(const std::string& log_path, std::vector<NamedPath> paths) const {
  paths.push_back({"--checkpoint", checkpoint_});
  paths.push_back({log_.empty() ? "--report" : "--log", log_path});
  paths.push_back({"--report", report_});
  if (!report_.empty()) paths.push_back({"--report", report_ + "/index.html"});
  // --checkpoint may overwrite the file of --resume.
  if (check_distinct({{"--checkpoint", checkpoint_}, {"--resume", resume_}}).ok()) {
    paths.push_back({"--resume", resume_});
  }
  return check_distinct(paths);
}

Status TrainOptions::check_writable(const std::string& new_folder) const {
  for (const std::string* path : {&checkpoint_, &log_}) {
    if (!path->empty() && !is_in_new_folder(*path, new_folder)) STGS_TRY(check_can_write(*path));
  }
  if (report_.empty() || is_in_new_folder(report_, new_folder)) return {};
  return check_can_make_folder(report_);
}

Result<encoder::TrainSettings> TrainOptions::settings(const Session& session,
                                                      std::vector<NamedPath> outputs,
                                                      const std::string& new_folder) const {
  const CommonOptions& common = session.options;
  encoder::TrainSettings settings;
  settings.backend = common.backend;
  settings.preset = preset_;
  settings.iterations = iterations_;
  settings.max_primitives = max_primitives_;
  settings.max_seconds = max_seconds_;
  settings.seed = common.seed;
  if (!frame_memory_.empty()) {
    Result<std::uint64_t> bytes = parse_bytes(frame_memory_);
    if (!bytes.ok()) return usage_error("--frame-memory: {}", bytes.status().message());
    settings.frame_memory = *bytes;
  }
  settings.ablate = fmt::format("{}", fmt::join(ablate_, ","));
  settings.resume = resume_;
  settings.checkpoint = checkpoint_;
  settings.checkpoint_interval = checkpoint_interval_;
  settings.log_path = log_;
  settings.held_out_evaluations = num_evals_;
  settings.perceptual_weights = perceptual_weights_;
  std::vector<std::string> names;
  for (const auto& [name, value] : encoder::hyper_parameters(preset_)) names.push_back(name);
  for (const std::string& text : overrides_) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0) {
      return usage_error(
          "--set {}: expected KEY=VALUE; 'stgs train --list-parameters' lists the keys", text);
    }
    const std::string key = text.substr(0, equals);
    if (std::find(names.begin(), names.end(), key) == names.end()) {
      const std::string near = nearest_word(key, names);
      return usage_error(
          "--set {}: unknown hyper-parameter{}; 'stgs train --list-parameters' lists them", key,
          near.empty() ? "" : fmt::format(" (did you mean '{}'?)", near));
    }
    if ((key == "iterations" && iterations_ != 0) ||
        (key == "max_primitives" && max_primitives_ != 0)) {
      return usage_error("--set {}: conflicts with --{}; use one of them", text,
                         key == "iterations" ? "iterations" : "max-primitives");
    }
    if (std::any_of(settings.overrides.begin(), settings.overrides.end(),
                    [&key](const auto& set) { return set.first == key; })) {
      return usage_error("--set {}: {} is set twice; set it once", text, key);
    }
    settings.overrides.emplace_back(key, text.substr(equals + 1));
  }
  if (!report_.empty() && log_.empty()) settings.log_path = report_ + "/training.jsonl";
  settings.ranks = session.world();
  STGS_TRY(check_paths(settings.log_path, std::move(outputs)));
  if (session.is_first()) STGS_TRY(check_writable(new_folder));
  return settings;
}

namespace {

Json to_json(const encoder::HeldOutScore& score) {
  return {{"psnr", score.psnr}, {"psnr_cc", score.psnr_cc}, {"images", score.images}};
}

Json to_json(const encoder::PerceptualReport& perceptual) {
  return {{"weights", perceptual.weights},
          {"linear", perceptual.linear},
          {"weight", perceptual.weight},
          {"patch", perceptual.patch}};
}

}  // namespace

Json to_json(const encoder::TrainReport& report) {
  return {{"backend", report.backend},
          {"iterations", report.iterations},
          {"seconds", report.seconds},
          {"importance_seconds", report.importance_seconds},
          {"primitives", report.primitives},
          {"final_loss", report.final_loss},
          {"frames",
           {{"budget", report.frames.budget},
            {"peak", report.frames.peak},
            {"resident", report.frames.resident},
            {"decoded", report.frames.decoded},
            {"waits", report.frames.waits},
            {"wait_seconds", report.frames.wait_seconds}}},
          {"held_out", report.held_out ? to_json(*report.held_out) : Json(nullptr)},
          {"perceptual", report.perceptual ? to_json(*report.perceptual) : Json(nullptr)},
          {"processes", report.processes}};
}

Status train_to_file(const encoder::PreparedCapture& capture, const std::string& output,
                     const std::string& title, const std::string& report_folder,
                     const encoder::TrainSettings& settings, Session& session,
                     encoder::TrainReport& report) {
  if (!settings.checkpoint.empty() && session.is_first()) {
    for (const std::string& file : remove_stale_files(settings.checkpoint)) {
      session.log(2, fmt::format("{}: removed; left over from a killed training", file));
    }
  }
  if (!report_folder.empty() && session.is_first()) {
    std::error_code error;
    std::filesystem::create_directories(report_folder, error);
    if (error) return io_error("{}: cannot create: {}", report_folder, error.message());
  }
  STGS_ASSIGN(Scene scene, encoder::train(capture, settings, session.progress_sink(),
                                          session.log_sink(), &report));
  if (!session.is_first()) return {};
  scene.metadata.title = title;
  WriteSettings writing;
  writing.profile = Profile::kLossless;
  STGS_TRY(write_scene(output, scene, writing));
  if (report_folder.empty()) return {};
  return write_train_report(report_folder, {capture, settings, report, scene, output}, session);
}

}  // namespace stgs::tools
