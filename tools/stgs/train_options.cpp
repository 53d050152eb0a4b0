// SPDX-License-Identifier: Apache-2.0
#include "encode_options.h"

#include <CLI/CLI.hpp>
#include <filesystem>

#include "options.h"
#include "output_path.h"
#include "train_report.h"

namespace stgs::tools {

void TrainOptions::declare(CLI::App& app) {
  const char* group = "Training";
  app.add_option("--preset", preset_, "fast, default or best")
      ->check(CLI::IsMember({"fast", "default", "best"}))
      ->capture_default_str()
      ->group(group);
  app.add_option("--iterations", iterations_,
                 "Views to learn from, one a step and process; else the preset's")
      ->check(number_between(1, 1e8))
      ->group(group);
  app.add_option("--max-primitives", max_primitives_, "Primitives at most; else the preset's")
      ->check(number_between(1, 2e8))
      ->group(group);
  app.add_option("--max-seconds", max_seconds_, "Time to train in; the schedule fits itself to it")
      ->check(number_between(1, 1e8))
      ->group(group);
  app.add_option(
         "--frame-memory", frame_memory_,
         "Memory for decoded frames, such as 512M or 8G; what does not fit is decoded again "
         "when it is needed. Else a share of what is free. Frames that steps under way or threads "
         "that decode still hold come on top")
      ->group(group);
  app.add_option("--resume", resume_,
                 "Checkpoint to go on from, bit for bit on the same kind of processor or GPU; on "
                 "another backend with a warning")
      ->group(group);
  auto* checkpoint =
      app.add_option("--checkpoint", checkpoint_, "Where to write checkpoints, also when stopped")
          ->group(group);
  app.add_option("--checkpoint-interval", checkpoint_interval_, "Steps between checkpoints")
      ->check(number_between(1, 1e8))
      ->capture_default_str()
      ->needs(checkpoint)
      ->group(group);
  app.add_option("--ablate", ablate_,
                 "Leave out, with commas: representation (4DGS's coupled one instead), lifespan (r "
                 "= 0), modulation (f = 1; with --set velocity_shrink=0 FreeTimeGS's motion), "
                 "initialisation (the points of the first frame alone, "
                 "all of them static, v = 0), densification (as 3DGS and 4DGS instead)")
      ->check(CLI::IsMember(encoder::ablation_names()))
      ->delimiter(',')
      ->allow_extra_args(false)
      ->group(group);
  app.add_option("--set", overrides_, "KEY=VALUE of a hyper-parameter; may be repeated")
      ->allow_extra_args(false)
      ->group(group);
  app.add_option("--perceptual-weights", perceptual_weights_,
                 "Safetensors file with VGG16's weights, for the perceptual loss; else it is off")
      ->group(group);
  app.add_option("--log", log_, "File for JSON lines: steps, and held-out measures")->group(group);
  app.add_option("--report", report_,
                 "Folder for a page with curves, test renders and statistics (index.html)")
      ->group(group);
  app.add_option("--num-evals", held_out_,
                 "How often in a run a few pictures of the test cameras are measured; 0: never")
      ->check(number_between(0, 1e6))
      ->capture_default_str()
      ->group(group);
}

Status TrainOptions::check_places(const std::string& log_path,
                                  std::vector<NamedPath> places) const {
  places.push_back({"--checkpoint", checkpoint_});
  places.push_back({log_.empty() ? "--report" : "--log", log_path});
  places.push_back({"--report", report_});
  if (!report_.empty()) places.push_back({"--report", report_ + "/index.html"});
  // A checkpoint may go on in its own place.
  if (check_distinct({{"--checkpoint", checkpoint_}, {"--resume", resume_}}).ok()) {
    places.push_back({"--resume", resume_});
  }
  return check_distinct(places);
}

Status TrainOptions::check_writable(const std::string& made) const {
  for (const std::string* path : {&checkpoint_, &log_}) {
    if (!path->empty() && !lies_in_new(*path, made)) STGS_TRY(check_can_write(*path));
  }
  if (report_.empty() || lies_in_new(report_, made)) return {};
  return check_can_make_folder(report_);
}

Result<encoder::TrainSettings> TrainOptions::settings(const Session& session,
                                                      std::vector<NamedPath> written,
                                                      const std::string& made) const {
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
  settings.held_out_evaluations = held_out_;
  settings.perceptual_weights = perceptual_weights_;
  std::vector<std::string> names;
  for (const auto& [name, value] : encoder::hyper_parameters(preset_)) names.push_back(name);
  for (const std::string& text : overrides_) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0) {
      return usage_error("--set {}: write KEY=VALUE; see 'stgs train --list-parameters'", text);
    }
    const std::string key = text.substr(0, equals);
    if (std::find(names.begin(), names.end(), key) == names.end()) {
      const std::string near = nearest_word(key, names);
      return usage_error("--set {}: no such hyper-parameter{}; see 'stgs train --list-parameters'",
                         key, near.empty() ? "" : fmt::format("; did you mean '{}'?", near));
    }
    if ((key == "iterations" && iterations_ != 0) ||
        (key == "max_primitives" && max_primitives_ != 0)) {
      return usage_error("--set {}: the option of that name is given too; leave one out", text);
    }
    if (std::any_of(settings.overrides.begin(), settings.overrides.end(),
                    [&key](const auto& set) { return set.first == key; })) {
      return usage_error("--set {}: {} is set twice; leave one out", text, key);
    }
    settings.overrides.emplace_back(key, text.substr(equals + 1));
  }
  if (!report_.empty() && log_.empty()) settings.log_path = report_ + "/training.jsonl";
  settings.ranks = session.world();
  STGS_TRY(check_places(settings.log_path, std::move(written)));
  if (session.is_first()) STGS_TRY(check_writable(made));
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
                     const std::string& report_folder, const encoder::TrainSettings& settings,
                     Session& session, encoder::TrainReport& report) {
  if (!settings.checkpoint.empty() && session.is_first()) {
    for (const std::string& file : remove_stale_files(settings.checkpoint)) {
      session.log(2, fmt::format("{}: removed, a killed training had left it", file));
    }
  }
  if (!report_folder.empty() && session.is_first()) {
    std::error_code error;
    std::filesystem::create_directories(report_folder, error);
    if (error) return io_error("{}: cannot create: {}", report_folder, error.message());
  }
  STGS_ASSIGN(const Scene scene, encoder::train(capture, settings, session.progress_sink(),
                                                session.log_sink(), &report));
  if (!session.is_first()) return {};
  WriteSettings writing;
  writing.profile = Profile::kLossless;
  STGS_TRY(write_scene(output, scene, writing));
  if (report_folder.empty()) return {};
  return write_train_report(report_folder, {capture, settings, report, scene, output}, session);
}

}  // namespace stgs::tools
