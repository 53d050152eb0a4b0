// SPDX-License-Identifier: Apache-2.0
// The jobs of the target sdk_encoder: training, packing and preparing, with chosen settings.
#include <algorithm>
#include <iterator>
#include <string_view>

#include "encoder_calls.h"
#include "stgs/encoder/train.h"

namespace stgs::fuzz {
namespace {

template <typename T>
void check_report(const ReportArgument<T>& report, stgs_result result) {
  if (result != STGS_OK)
    require(report.is_untouched(), "a failed call leaves its report unchanged");
}

// `bytes`: the reported size of the file; null: not reported.
void check_scene(const char* path, const std::uint64_t* bytes) {
  stgs_scene* scene = nullptr;
  require(stgs_scene_create(nullptr, &scene) == STGS_OK, "a scene can be created");
  require(stgs_scene_open(scene, path) == STGS_OK, "a written scene can be opened");
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  require(stgs_scene_get_info(scene, &info) == STGS_OK, "an open scene has information");
  require(bytes == nullptr || *bytes == info.file_bytes, "a report has the size of the file");
  stgs_scene_destroy(scene);
}

}  // namespace

stgs_train_settings EncoderCalls::training_settings() {
  stgs_train_settings s = short_training();
  for (int changes = choices_.next() % 4; changes > 0; --changes) {
    switch (choices_.next() % 14) {
      case 0:
        s.preset = choices_.small_int();
        break;
      case 1:
        s.backend = choices_.small_int();
        break;
      case 2: {
        constexpr std::uint32_t kIterations[] = {1, 2, 3, 100'000'001, UINT32_MAX};
        s.iterations = choices_.pick(kIterations);
        break;
      }
      case 3:
        s.max_primitives = choices_.count();
        break;
      case 4:
        s.max_seconds = choices_.number();
        if (s.max_seconds >= 1) s.max_seconds = -s.max_seconds;  // a longer run is too slow
        break;
      case 5:
        s.seed = choices_.next() * std::uint64_t{0x0101010101010101};
        break;
      case 6:
        s.checkpoint =
            choose_path({nullptr, "", "run.ckpt", "new.ckpt", "out.stgs", "none/x", "empty"});
        break;
      case 7:
        s.checkpoint_interval = choices_.count();
        break;
      case 8:
        s.resume =
            choose_path({nullptr, "", "run.ckpt", "new.ckpt", "scene.stgs", "none", "empty"});
        break;
      case 9:
        s.log_path =
            choose_path({nullptr, "", "run.jsonl", "run.ckpt", "out.stgs", "none/x", "empty"});
        break;
      case 10:
        s.held_out_evaluations = choices_.count();
        break;
      case 11:
        s.frame_memory = choices_.count() * std::uint64_t{choices_.next()};
        break;
      case 12:
        s.perceptual_weights = choose_path({nullptr, "", "notes.txt", "none", "empty"});
        break;
      default:
        choose_parameters(s);
        break;
    }
  }
  return s;
}

void EncoderCalls::choose_parameters(stgs_train_settings& settings) {
  static const auto names = encoder::hyper_parameters("fast");
  constexpr const char* kValues[] = {"0",   "1",   "2",    "0.5", "-1",    "1e-9", "1e9",
                                     "nan", "inf", "fast", "",    "1e999", nullptr};
  settings.parameter_count = 1 + choices_.next() % 2;
  for (stgs_parameter& parameter : parameters_) {
    const std::uint8_t index = choices_.next();
    parameter.name = index < 2 ? nullptr : names[index % names.size()].parameter.name;
    parameter.value = choices_.pick(kValues);
    // A large number of iterations is too slow.
    if (index >= 2 &&
        std::string_view(names[index % names.size()].parameter.name) == "iterations") {
      parameter.name = "no_such_rate";
    }
  }
  settings.parameters = choices_.next() % 16 == 1 ? nullptr : parameters_;
}

void EncoderCalls::check_training() {
  SettingsArgument<stgs_train_settings> settings(training_settings(), choices_);
  run({}, {}, [&] { return stgs_encoder_check_training(encoder_, settings.get()); });
}

void EncoderCalls::train() {
  const stgs_train_settings chosen = training_settings();
  const char* const scene =
      choose_path({"out.stgs", "scene.stgs", nullptr, "", "none/x.stgs", "empty", "run.ckpt"});
  constexpr const char* kNone = "none";
  const char* const capture =
      choices_.next() % 8 == 1
          ? choose_path({nullptr, "", kNone, "notes.txt", "empty", "scene.stgs"})
          : initial_files().capture().c_str();
  SettingsArgument<stgs_train_settings> argument(chosen, choices_);
  // Null and truncated settings mean the defaults, which are a long training.
  const stgs_train_settings* const settings =
      argument.get() == nullptr || argument.get()->struct_size < sizeof chosen ? &chosen
                                                                               : argument.get();
  ReportArgument<stgs_train_report> report(choices_.next());
  std::set<std::string> others;
  for (const char* path : {chosen.checkpoint, chosen.log_path}) {
    if (path != nullptr) others.insert(path);
  }
  const stgs_result result = run({scene == nullptr ? "" : scene}, others, [&] {
    return stgs_encoder_train(encoder_, capture, scene, settings, report.get());
  });
  check_report(report, result);
  if (result == STGS_OK) check_scene(scene, report.is_complete() ? &report.value().bytes : nullptr);
}

stgs_pack_settings EncoderCalls::pack_settings() {
  stgs_pack_settings s = default_settings(stgs_pack_settings_defaults);
  for (int changes = choices_.next() % 4; changes > 0; --changes) {
    double stgs_pack_settings::*const numbers[] = {
        &stgs_pack_settings::quality,         &stgs_pack_settings::target_kbps,
        &stgs_pack_settings::max_error,       &stgs_pack_settings::chunk_seconds,
        &stgs_pack_settings::metres_per_unit, &stgs_pack_settings::audio_begin};
    switch (choices_.next() % 8) {
      case 0:
        s.profile = choices_.small_int();
        break;
      case 1:
        s.tiers = choices_.small_int();
        break;
      case 2:
        s.up[choices_.next() % 3] = static_cast<float>(choices_.number());
        break;
      case 3:
        s.floor[choices_.next() % 3] = static_cast<float>(choices_.number());
        s.has_floor = choices_.small_int();
        break;
      case 4: {
        static const std::string kLong = "=" + std::string(100'000, 'x');
        s.audio = choose_path(
            {nullptr, "", "=music.opus", "=a b", "=\xFF\xC0", "=http://[", kLong.c_str()});
        break;
      }
      case 5:
        s.against = choices_.next() % 2 == 0 ? initial_files().capture().c_str()
                                             : choose_path({"", "none", "empty", "notes.txt"});
        break;
      default:
        s.*numbers[choices_.next() % std::size(numbers)] = choices_.number();
        break;
    }
  }
  return s;
}

void EncoderCalls::pack() {
  SettingsArgument<stgs_pack_settings> settings(pack_settings(), choices_);
  const char* const scene = choose_path(
      {"scene.stgs", "out.stgs", nullptr, "", "notes.txt", "none", "empty", "run.ckpt"});
  const char* const output = choose_path(
      {"out.stgs", "packed.stgs", "scene.stgs", nullptr, "", "none/x.stgs", "empty", "notes.txt"});
  ReportArgument<stgs_pack_report> report(choices_.next());
  const stgs_result result = run({output == nullptr ? "" : output}, {}, [&] {
    return stgs_encoder_pack(encoder_, scene, output, settings.get(), report.get());
  });
  check_report(report, result);
  if (result == STGS_OK) {
    check_scene(output, report.is_complete() ? &report.value().bytes_out : nullptr);
  }
}

// Covers only the checks before the work: a capture takes videos and is slow to prepare.
void EncoderCalls::prepare() {
  stgs_prepare_settings s = default_settings(stgs_prepare_settings_defaults);
  const char* const names[] = {"cam00", "", nullptr};
  for (int changes = choices_.next() % 4; changes > 0; --changes) {
    std::uint32_t stgs_prepare_settings::*const counts[] = {
        &stgs_prepare_settings::test_camera_count, &stgs_prepare_settings::max_dynamic_points,
        &stgs_prepare_settings::max_static_points};
    std::int32_t stgs_prepare_settings::*const integers[] = {
        &stgs_prepare_settings::layout,          &stgs_prepare_settings::first_frame,
        &stgs_prepare_settings::end_frame,       &stgs_prepare_settings::default_test_cameras,
        &stgs_prepare_settings::separate_motion, &stgs_prepare_settings::overwrite,
        &stgs_prepare_settings::backend};
    const std::uint8_t kind = choices_.next();
    if (kind % 4 == 0) s.scale = choices_.number();
    if (kind % 4 == 1) s.fps = choices_.number();
    if (kind % 4 == 2) s.*counts[kind / 4 % 3] = choices_.count() % 4;
    if (kind % 4 == 3) s.*integers[kind / 4 % 7] = choices_.small_int();
  }
  if (choices_.next() % 4 != 1) s.test_cameras = names;
  s.test_camera_count = std::min<std::uint32_t>(s.test_camera_count, std::size(names));
  SettingsArgument<stgs_prepare_settings> settings(s, choices_);
  const char* const capture = choose_path({"empty", nullptr, "", "notes.txt", "none"});
  const char* const prepared =
      choose_path({"prepared", "empty", nullptr, "", "notes.txt", "none/x"});
  ReportArgument<stgs_prepare_report> report(choices_.next());
  const stgs_result result = run({}, {}, [&] {
    return stgs_encoder_prepare(encoder_, capture, prepared, settings.get(), report.get());
  });
  check_report(report, result);
  require(result != STGS_OK, "a folder without videos cannot be prepared");
}

}  // namespace stgs::fuzz
