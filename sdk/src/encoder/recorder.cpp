// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/scene_recorder.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "encoder/encoder.h"
#include "view_camera.h"

struct stgs_recorder {
  stgs::sdk::LastError error;
  std::unique_ptr<stgs::SceneRecorder> recorder;  // null: not begun
  std::uint32_t threads = 0;

  stgs::sdk::Outcome check_recording() const {
    if (recorder == nullptr) {
      return {STGS_ERROR_STATE, "nothing is recorded: call stgs_recorder_begin or _resume first"};
    }
    if (recorder->is_open()) return {};
    return {STGS_ERROR_STATE, "the recording is closed, or an error has ended it"};
  }
  stgs::sdk::Outcome check_not_begun() const {
    if (recorder == nullptr) return {};
    return {STGS_ERROR_STATE, "a recorder makes one file: make another one"};
  }
};

namespace stgs::sdk {
namespace {

constexpr std::uint64_t kMostPrimitives = 200'000'000;
constexpr float kLeastOpacity = 0.001f, kMostOpacity = 0.999f;  // whose logits are finite
constexpr double kFar = 1e9;
constexpr std::size_t kMostText = 4096;  // bytes

stgs_record_settings default_settings() {
  const RecordSettings defaults;
  stgs_record_settings settings{};
  settings.struct_size = sizeof(settings);
  settings.time_base_numerator = 1;
  settings.time_base_denominator = 30;
  settings.profile = STGS_PROFILE_QUANTISED;
  settings.tiers = defaults.write.tiers;
  settings.quality = defaults.write.quality;
  settings.sync = 1;
  return settings;
}

stgs_fragment default_stretch() {
  stgs_fragment stretch{};
  stretch.struct_size = sizeof(stretch);
  stretch.frames = 1;
  return stretch;
}

Outcome check_text(const char* field, const char* text) {
  const std::size_t bytes = text_of(text).size();
  if (bytes <= kMostText) return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("settings: {} has {} bytes, more than {}", field, bytes, kMostText)};
}

Outcome check(const stgs_record_settings& s) {
  constexpr double kMost = std::numeric_limits<std::uint32_t>::max();
  STGS_SDK_TRY(check_range("time_base_numerator", s.time_base_numerator, 1, kMost));
  STGS_SDK_TRY(check_range("time_base_denominator", s.time_base_denominator, 1, kMost));
  STGS_SDK_TRY(check_range("sh_degree", s.sh_degree, 0, 3));
  STGS_SDK_TRY(check_range("profile", s.profile, STGS_PROFILE_QUANTISED, STGS_PROFILE_DRACO));
  STGS_SDK_TRY(check_range("tiers", s.tiers, 0, 16));
  STGS_SDK_TRY(check_range("quality", s.quality, 0, 100));
  STGS_SDK_TRY(check_range("max_error", s.max_error, 1e-6, 1e9, "as quality has it"));
  STGS_SDK_TRY(check_range("chunk_seconds", s.chunk_seconds, 0.01, 3600, "by the first stretch"));
  STGS_SDK_TRY(check_flag("sync", s.sync));
  STGS_SDK_TRY(check_range("threads", s.threads, 0, kMostThreads));
  STGS_SDK_TRY(check_range("metres_per_unit", s.metres_per_unit, 1e-9, 1e9, "not known"));
  for (const float x : s.up) STGS_SDK_TRY(check_range("up", x, -kFar, kFar));
  for (const float x : s.floor) STGS_SDK_TRY(check_range("floor", x, -kFar, kFar));
  STGS_SDK_TRY(check_text("title", s.title));
  STGS_SDK_TRY(check_text("audio", s.audio));
  return check_range("audio_begin", s.audio_begin, -1e6, 1e6);
}

RecordSettings recording_of(const stgs_record_settings& s) {
  RecordSettings settings;
  settings.write.profile = s.profile == STGS_PROFILE_DRACO ? Profile::kDraco : Profile::kQuantised;
  settings.write.tiers = s.tiers;
  settings.write.quality = s.quality;
  settings.write.max_error = s.max_error / 1000;
  settings.write.chunk_seconds = s.chunk_seconds;
  settings.sync = s.sync != 0;
  return settings;
}

Outcome take_start_view(const stgs_view* given, SceneMetadata& metadata) {
  if (given == nullptr) return {};
  stgs_view view{};
  STGS_SDK_TRY(take_struct(given, view, "settings: start_view"));
  if (!(view.near_plane > 0 && std::isfinite(view.near_plane))) {
    return {STGS_ERROR_ARGUMENT, fmt::format("settings: start_view's near_plane is {}; it must be "
                                             "positive",
                                             view.near_plane)};
  }
  metadata.start_camera = camera_of(view);
  metadata.near_plane = view.near_plane;
  std::copy_n(view.background, 3, metadata.background);
  return {};
}

Outcome take_metadata(const stgs_record_settings& s, SceneMetadata& metadata) {
  metadata.time_base = {s.time_base_numerator, s.time_base_denominator};
  metadata.generator = fmt::format("libstgs_encoder {}.{}.{}", STGS_VERSION_MAJOR,
                                   STGS_VERSION_MINOR, STGS_VERSION_PATCH);
  metadata.title = text_of(s.title);
  metadata.metres_per_unit = static_cast<float>(s.metres_per_unit);
  if (const double length = std::hypot(s.up[0], s.up[1], s.up[2]); length > 0) {
    for (int i = 0; i < 3; ++i) metadata.up[i] = static_cast<float>(s.up[i] / length);
    std::copy_n(s.floor, 3, metadata.floor);
  }
  metadata.audio = text_of(s.audio);
  metadata.audio_begin = metadata.time_base.ticks(s.audio_begin);
  return take_start_view(s.start_view, metadata);
}

Outcome wrong(std::string message) {
  return {STGS_ERROR_ARGUMENT, "stretch: " + std::move(message)};
}

Outcome check(const stgs_fragment& s, std::uint32_t frames) {
  if (s.frames == 0) return wrong("its frames are 0; it has one at least");
  constexpr std::uint32_t kMost = std::numeric_limits<std::uint32_t>::max();
  if (std::max(s.frames, s.visible_frames) > kMost - frames) {
    return wrong(fmt::format("{} frames after {} are more than a file can have",
                             std::max(s.frames, s.visible_frames), frames));
  }
  if (s.count > kMostPrimitives) {
    return wrong(fmt::format("{} primitives, more than {}", s.count, kMostPrimitives));
  }
  const std::pair<const char*, const float*> needed[] = {
      {"position", s.position}, {"scale", s.scale}, {"opacity", s.opacity}, {"sh", s.sh}};
  for (const auto& [name, array] : needed) {
    if (s.count > 0 && array == nullptr) return wrong(fmt::format("{} is NULL", name));
  }
  const bool whole = s.time == nullptr;
  if ((s.sigma == nullptr) != whole || (s.radius == nullptr) != whole) {
    return wrong("time, sigma and radius go together: give all three, or none");
  }
  return {};
}

// By the names that the caller knows; the recorder checks what comes of them.
Outcome check_finite(const stgs_fragment& s, int sh_degree) {
  const auto coefficients = static_cast<std::size_t>(3 * (sh_degree + 1) * (sh_degree + 1));
  const struct {
    const char* name;
    const float* values;
    std::size_t each;
  } arrays[] = {{"position", s.position, 3}, {"velocity", s.velocity, 3},
                {"scale", s.scale, 3},       {"rotation", s.rotation, 4},
                {"opacity", s.opacity, 1},   {"sh", s.sh, coefficients},
                {"time", s.time, 1},         {"sigma", s.sigma, 1},
                {"radius", s.radius, 1},     {"importance", s.importance, 1}};
  for (const auto& array : arrays) {
    const std::size_t count = array.values == nullptr ? 0 : array.each * s.count;
    const float* const wrong_one = std::find_if_not(array.values, array.values + count,
                                                    [](float v) { return std::isfinite(v); });
    if (wrong_one == array.values + count) continue;
    const auto at = static_cast<std::size_t>(wrong_one - array.values);
    const std::string component =
        array.each > 1 ? fmt::format("[{}]", at % array.each) : std::string();
    return wrong(fmt::format("{}{} of primitive {} is {}, not a finite number", array.name,
                             component, at / array.each, *wrong_one));
  }
  return {};
}

// The stretch as the format has it, in ticks of `seconds`. What the recorder checks is left to it.
Outcome take_primitives(const stgs_fragment& s, int sh_degree, double seconds, Gaussians4D& set) {
  const auto n = static_cast<std::size_t>(s.count);
  STGS_SDK_TRY(check_finite(s, sh_degree));
  set.sh_degree = sh_degree;
  set.resize(n);
  std::copy_n(s.sh, set.sh.size(), set.sh.begin());
  std::copy_n(s.position, 3 * n, set.position.begin());
  if (s.rotation != nullptr) std::copy_n(s.rotation, 4 * n, set.rotation.begin());
  for (std::size_t i = 0; i < 3 * n; ++i) {
    if (!(s.scale[i] > 0)) {
      return wrong(fmt::format("scale of primitive {} is {}, not > 0", i / 3, s.scale[i]));
    }
    set.log_scale[i] = std::log(s.scale[i]);
    if (s.velocity != nullptr) set.velocity[i] = static_cast<float>(s.velocity[i] * seconds);
  }
  // From the first frame, in full, to beyond the last at which it may be seen.
  const auto always = 2.0f * static_cast<float>(std::max(s.frames, s.visible_frames));
  for (std::size_t i = 0; i < n; ++i) {
    if (!(s.opacity[i] >= 0 && s.opacity[i] <= 1)) {
      return wrong(fmt::format("opacity of primitive {} is {}, not 0 to 1", i, s.opacity[i]));
    }
    const float opacity = std::clamp(s.opacity[i], kLeastOpacity, kMostOpacity);
    set.opacity_logit[i] = std::log(opacity / (1 - opacity));
    if (s.rotation == nullptr) set.rotation[4 * i] = 1;
    set.time[i] = s.time == nullptr ? 0 : static_cast<float>(s.time[i] / seconds);
    set.sigma[i] = s.sigma == nullptr ? always : static_cast<float>(s.sigma[i] / seconds);
    set.radius[i] = s.radius == nullptr ? always : static_cast<float>(s.radius[i] / seconds);
  }
  return {};
}

Outcome take_path_and_settings(const stgs_recorder& recorder, const char* path,
                               const stgs_record_settings* given, stgs_record_settings& settings) {
  STGS_SDK_TRY(recorder.check_not_begun());
  STGS_SDK_TRY(check_path("path", path));
  STGS_SDK_TRY(take_settings(given, settings));
  return check(settings);
}

Outcome append(stgs_recorder& to, const stgs_fragment& stretch) {
  SceneRecorder& recorder = *to.recorder;
  STGS_SDK_TRY(check(stretch, recorder.frames()));
  Gaussians4D set;
  STGS_SDK_TRY(take_primitives(stretch, recorder.sh_degree(),
                               recorder.metadata().time_base.seconds(1), set));
  std::span<const float> importance;
  if (stretch.importance != nullptr) importance = {stretch.importance, set.size()};
  const std::uint32_t begin = recorder.frames();
  Outcome outcome;
  run_on(to.threads, [&] {
    outcome =
        recorder.append(set, begin + stretch.frames, importance, begin + stretch.visible_frames);
  });
  return outcome;
}

}  // namespace
}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_record_settings_defaults(stgs_record_settings* settings, size_t struct_size) {
  return stgs::sdk::put_defaults(settings, struct_size, stgs::sdk::default_settings());
}

stgs_result stgs_fragment_defaults(stgs_fragment* stretch, size_t struct_size) {
  return stgs::sdk::put_defaults(stretch, struct_size, stgs::sdk::default_stretch());
}

stgs_result stgs_recorder_create(stgs_recorder** out) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  *out = new (std::nothrow) stgs_recorder;
  return *out == nullptr ? STGS_ERROR_OUT_OF_MEMORY : STGS_OK;
}

void stgs_recorder_destroy(stgs_recorder* recorder) {
  delete recorder;
}

stgs_result stgs_recorder_error(const stgs_recorder* recorder, stgs_error* error) {
  return recorder == nullptr ? STGS_ERROR_ARGUMENT : recorder->error.tell(error);
}

stgs_result stgs_recorder_begin(stgs_recorder* recorder, const char* path,
                                const stgs_record_settings* settings) {
  using namespace stgs::sdk;
  return guarded(recorder, [&]() -> Outcome {
    stgs_record_settings taken = default_settings();
    STGS_SDK_TRY(take_path_and_settings(*recorder, path, settings, taken));
    stgs::SceneMetadata metadata;
    STGS_SDK_TRY(take_metadata(taken, metadata));
    auto made = stgs::SceneRecorder::create(path, metadata, taken.sh_degree, recording_of(taken));
    if (!made.ok()) return made.status();
    recorder->recorder = std::move(made).value();
    recorder->threads = taken.threads;
    return {};
  });
}

stgs_result stgs_recorder_resume(stgs_recorder* recorder, const char* path,
                                 const stgs_record_settings* settings) {
  using namespace stgs::sdk;
  return guarded(recorder, [&]() -> Outcome {
    stgs_record_settings taken = default_settings();
    STGS_SDK_TRY(take_path_and_settings(*recorder, path, settings, taken));
    auto made = stgs::SceneRecorder::resume(path, recording_of(taken));
    if (!made.ok()) return made.status();
    recorder->recorder = std::move(made).value();
    recorder->threads = taken.threads;
    return {};
  });
}

stgs_result stgs_recorder_append(stgs_recorder* recorder, const stgs_fragment* stretch) {
  using namespace stgs::sdk;
  return guarded(recorder, [&]() -> Outcome {
    STGS_SDK_TRY(recorder->check_recording());
    stgs_fragment taken = default_stretch();
    STGS_SDK_TRY(take_struct(stretch, taken, "stretch"));
    return append(*recorder, taken);
  });
}

stgs_result stgs_recorder_close(stgs_recorder* recorder) {
  using namespace stgs::sdk;
  return guarded(recorder, [&]() -> Outcome {
    STGS_SDK_TRY(recorder->check_recording());
    return recorder->recorder->close();
  });
}

stgs_result stgs_recorder_get_status(stgs_recorder* recorder, stgs_recorder_status* status) {
  using namespace stgs::sdk;
  return guarded(recorder, [&]() -> Outcome {
    if (recorder->recorder == nullptr) return recorder->check_recording();
    STGS_SDK_TRY(check_struct(status, "status"));
    const stgs::SceneRecorder& of = *recorder->recorder;
    const stgs::TimeBase& time_base = of.metadata().time_base;
    give_struct(status, {sizeof(*status), of.bytes(), of.frames(), time_base.numerator,
                         time_base.denominator, of.sh_degree(), of.primitives(), of.dropped()});
    return {};
  });
}

}  // extern "C"
