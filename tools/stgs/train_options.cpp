// SPDX-License-Identifier: Apache-2.0
#include "encode_options.h"

#include <filesystem>

#include "options.h"
#include "output_path.h"
#include "parameter_options.h"
#include "stgs/encoder/camera_json.h"
#include "train_report.h"
#include "usage.h"

namespace stgs::tools {

void TrainOptions::declare(Arguments& app, bool with_packing) {
  const char* group = "Training";
  with_choices(
      app.add_option("--preset", settings_.preset, "Training preset: fast, default or best"),
      {"fast", "default", "best"})
      ->capture_default_str()
      ->group(group);
  const std::set<std::string> of_packing = {"quality", "target_kbps", "target_size", "target_psnr"};
  const auto options = declare_parameters<encoder::TrainParameters>(
      app, settings_, group, with_packing ? of_packing : std::set<std::string>());
  if (!with_packing) exclude_limits(options);
  app.add_option(
         "--frame-memory", frame_memory_,
         "Memory for decoded frames, for example 512M or 8G (default: a share of the free memory). "
         "Frames that do not fit are decoded again when needed. Frames in use by steps in flight "
         "and by decoding threads are extra")
      ->check(accepted_by<parse_bytes>)
      ->group(group);
  app.add_option(
         "--resume", settings_.resume,
         "Checkpoint to resume from; bit-exact on the same kind of CPU or GPU, with a warning "
         "on another backend")
      ->group(group);
  options.at("checkpoint_interval")
      ->needs(app.add_option("--checkpoint", settings_.checkpoint,
                             "Write checkpoints to this file, periodically and when interrupted")
                  ->group(group));
  with_choices(
      app.add_option("--method", settings_.method,
                     "Method to train: sharptimegs, or freetimegs or 4dgs as published, to "
                     "compare with"),
      encoder::method_names())
      ->capture_default_str()
      ->group(group);
  with_choices(
      app.add_option(
          "--ablate", ablate_,
          "Disable parts of sharptimegs, comma-separated: representation (use the coupled one "
          "of 4DGS), lifespan (r = 0), modulation (f = 1), initialisation (points of the first "
          "frame only, all static, v = 0), densification (as in 3DGS and 4DGS)"),
      encoder::ablation_names())
      ->delimiter(',')
      ->allow_extra_args(false)
      ->group(group);
  app.add_option("--set", overrides_,
                 "Set a hyper-parameter, KEY=VALUE; repeatable (see --list-parameters)")
      ->allow_extra_args(false)
      ->group(group);
  app.add_option("--perceptual-weights", settings_.perceptual_weights,
                 "Safetensors file with the weights of SqueezeNet 1.1, VGG16 or AlexNet; enables "
                 "the perceptual loss")
      ->group(group);
  app.add_flag(
         "--refine-cameras", settings_.refine_cameras,
         "Refine poses, focal lengths, distortion and vignetting of the training cameras with the "
         "scene; --format json lists them")
      ->group(group);
  app.add_flag("--refine-timing", settings_.refine_timing,
               "Refine the time offsets of the training cameras, of a rig without synchronisation, "
               "with the scene; --format json lists them")
      ->group(group);
  app.add_flag("--foreground", settings_.foreground,
               "Train only the content inside the masks of the capture, with its alpha")
      ->group(group);
  app.add_option("--log", settings_.log_path,
                 "Write steps and evaluations to this file, as JSON lines")
      ->group(group);
  app.add_option("--title", title_, "Metadata: title of the scene, shown by players and info")
      ->group(group);
  app.add_option("--report", report_,
                 "Write a report to this folder: curves, test renders and statistics (index.html)")
      ->group(group);
}

void TrainOptions::train_for(const encoder::PackSettings& packing) {
  settings_.quality = packing.quality;
  settings_.target_kbps = packing.target_kbps;
  settings_.target_size = packing.target_size;
  settings_.target_psnr = packing.target_psnr;
}

Status TrainOptions::check_paths(const std::string& log_path, std::vector<NamedPath> paths) const {
  paths.push_back({"--checkpoint", settings_.checkpoint});
  paths.push_back({has_log() ? "--log" : "--report", log_path});
  paths.push_back({"--report", report_});
  if (!report_.empty()) paths.push_back({"--report", report_ + "/index.html"});
  // --checkpoint may overwrite the file of --resume.
  const NamedPath resume = {"--resume", settings_.resume};
  if (check_distinct({{"--checkpoint", settings_.checkpoint}, resume}).ok()) {
    paths.push_back(resume);
  }
  return check_distinct(paths);
}

Status TrainOptions::claim_outputs(const std::string& new_folder, Session& session) const {
  for (const std::string* path : {&settings_.checkpoint, &settings_.log_path}) {
    if (!path->empty() && !is_in_new_folder(*path, new_folder))
      STGS_TRY(session.claim_output(*path));
  }
  if (report_.empty() || is_in_new_folder(report_, new_folder)) return {};
  return session.claim_folder(report_);
}

Status TrainOptions::add_overrides(encoder::TrainSettings& settings) const {
  std::vector<std::string> names;
  for (const auto& hyper : encoder::hyper_parameters(settings_.preset)) {
    names.emplace_back(hyper.parameter.name);
  }
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
    if ((key == "iterations" && settings.iterations != 0) ||
        (key == "max_primitives" && settings.max_primitives != 0)) {
      return usage_error("--set {}: conflicts with --{}; use one of them", text,
                         key == "iterations" ? "iterations" : "max-primitives");
    }
    if (std::any_of(settings.overrides.begin(), settings.overrides.end(),
                    [&key](const auto& set) { return set.first == key; })) {
      return usage_error("--set {}: {} is set twice; set it once", text, key);
    }
    settings.overrides.emplace_back(key, text.substr(equals + 1));
  }
  return {};
}

Result<encoder::TrainSettings> TrainOptions::settings(Session& session,
                                                      std::vector<NamedPath> outputs,
                                                      const std::string& new_folder) const {
  const CommonOptions& common = session.options;
  encoder::TrainSettings settings = settings_;
  settings.backend = common.backend;
  settings.seed = common.seed;
  if (!frame_memory_.empty()) {
    STGS_ASSIGN(settings.frame_memory, parse_bytes(frame_memory_));
  }
  settings.ablate = fmt::format("{}", fmt::join(ablate_, ","));
  STGS_TRY(add_overrides(settings));
  if (!report_.empty() && !has_log()) settings.log_path = report_ + "/training.jsonl";
  settings.share = session.machine_share();
  settings.ranks = session.world();
  STGS_TRY(check_paths(settings.log_path, std::move(outputs)));
  if (session.is_first()) STGS_TRY(claim_outputs(new_folder, session));
  return settings;
}

namespace {

Json to_json(const encoder::HeldOutScore& score) {
  return {{"psnr", score.psnr}, {"psnr_cc", score.psnr_cc}, {"images", score.images}};
}

Json to_json(const encoder::PerceptualReport& perceptual) {
  return {{"weights", perceptual.weights},
          {"network", perceptual.network},
          {"linear", perceptual.linear},
          {"weight", perceptual.weight},
          {"patch", perceptual.patch}};
}

Json to_json(const std::vector<encoder::RefinedCamera>& cameras) {
  Json json = Json::array();
  for (const encoder::RefinedCamera& refined : cameras) {
    Json camera = encoder::camera_to_json(refined.camera);
    camera["degrees"] = refined.degrees;
    camera["shift"] = refined.shift;
    camera["zoom"] = refined.zoom;
    camera["pixels"] = refined.pixels;
    camera["distortion"] = refined.distortion;
    camera["corner_pixels"] = refined.corner_pixels;
    camera["corner_brightness"] = refined.corner_brightness;
    camera["time_shift"] = refined.time_shift;
    camera["time_offset"] = refined.time_offset;
    json.push_back(std::move(camera));
  }
  return json;
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
          {"processes", report.processes},
          {"cameras", to_json(report.cameras)}};
}

Status train_to_file(const encoder::PreparedCapture& capture, const std::string& output,
                     const std::string& title, const std::string& report_folder,
                     const encoder::TrainSettings& settings, Session& session,
                     encoder::TrainReport& report) {
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
  const Status written = write_scene(output, scene, writing);
  if (written.code() == StatusCode::kUsage) {  // the values, which are no arguments
    return settings.resume.empty()
               ? runtime_error("{}: training diverged: {}", output, written.message())
               : invalid_file("{}: damaged checkpoint: {}; resume from another one",
                              settings.resume, written.message());
  }
  STGS_TRY(written);
  if (report_folder.empty()) return {};
  return write_train_report(report_folder, {capture, settings, report, scene, output}, session);
}

}  // namespace stgs::tools
