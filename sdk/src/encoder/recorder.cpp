// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/scene_recorder.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "encoder/encoder.h"
#include "encoder/record_parameters.h"
#include "view_camera.h"

struct stgs_recorder {
  stgs::sdk::LastError error;
  std::unique_ptr<stgs::SceneRecorder> recorder;  // null: not begun
  std::unique_ptr<stgs::TaskRunner> threads;      // null: the default pool

  stgs::sdk::Outcome check_recording() const {
    if (recorder == nullptr) {
      return {STGS_ERROR_STATE,
              "no recording was begun; call stgs_recorder_begin or stgs_recorder_resume first"};
    }
    if (recorder->is_open()) return {};
    return {STGS_ERROR_STATE, "the recording is closed, or ended by an error"};
  }
  stgs::sdk::Outcome check_not_begun() const {
    if (recorder == nullptr) return {};
    return {STGS_ERROR_STATE, "the recorder already has a file; create another recorder"};
  }
};

namespace stgs::sdk {
namespace {

constexpr std::uint64_t kMaxPrimitives = 200'000'000;
constexpr float kMinOpacity = 0.001f, kMaxOpacity = 0.999f;  // with finite logits

stgs_record_settings default_record_settings() {
  const RecordSettings defaults;
  stgs_record_settings settings{};
  settings.struct_size = sizeof(settings);
  settings.time_base_numerator = 1;
  settings.time_base_denominator = 30;
  settings.profile = STGS_PROFILE_QUANTISED;
  settings.tiers = defaults.write.tiers;
  settings.quality = defaults.write.quality;
  settings.chunk_seconds = defaults.write.chunk_seconds;
  settings.sync = 1;
  return settings;
}

stgs_fragment default_fragment() {
  stgs_fragment fragment{};
  fragment.struct_size = sizeof(fragment);
  fragment.frames = 1;
  return fragment;
}

Outcome check(const stgs_record_settings& s) {
  constexpr double kMax = std::numeric_limits<std::uint32_t>::max();
  STGS_SDK_TRY(check_range("time_base_numerator", s.time_base_numerator, 1, kMax));
  STGS_SDK_TRY(check_range("time_base_denominator", s.time_base_denominator, 1, kMax));
  STGS_SDK_TRY(check_range("sh_degree", s.sh_degree, 0, 3));
  STGS_SDK_TRY(check_range("profile", s.profile, STGS_PROFILE_QUANTISED, STGS_PROFILE_DRACO));
  STGS_SDK_TRY(check_ranges<RecordParameters>(s));
  STGS_SDK_TRY(check_flag("sync", s.sync));
  STGS_SDK_TRY(check_flag("kernel", s.kernel));
  STGS_SDK_TRY(check_range("threads", s.threads, 0, kMaxThreads));
  for (const float x : s.up) STGS_SDK_TRY(check_range(encoder::kUp, x));
  for (const float x : s.floor) STGS_SDK_TRY(check_range(encoder::kFloor, x));
  STGS_SDK_TRY(check_text("title", s.title));
  return check_text("audio", s.audio);
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

Outcome copy_in_start_view(const stgs_view* given, SceneMetadata& metadata) {
  if (given == nullptr) return {};
  stgs_view view{};
  STGS_SDK_TRY(copy_in(given, view, "settings: start_view"));
  if (!(view.near_plane > 0 && std::isfinite(view.near_plane))) {
    return {STGS_ERROR_ARGUMENT, fmt::format("settings: start_view: near_plane is {} (expected a "
                                             "positive number)",
                                             view.near_plane)};
  }
  metadata.start_camera = camera_of(view);
  metadata.near_plane = view.near_plane;
  std::copy_n(view.background, 3, metadata.background);
  return {};
}

Outcome copy_in_metadata(const stgs_record_settings& s, SceneMetadata& metadata) {
  metadata.time_base = {s.time_base_numerator, s.time_base_denominator};
  metadata.generator = fmt::format("libstgs_encoder {}.{}.{}", STGS_VERSION_MAJOR,
                                   STGS_VERSION_MINOR, STGS_VERSION_PATCH);
  metadata.title = text_of(s.title);
  metadata.kernel = static_cast<std::uint8_t>(s.kernel);
  metadata.metres_per_unit = static_cast<float>(s.metres_per_unit);
  if (const double length = std::hypot(s.up[0], s.up[1], s.up[2]); length > 0) {
    for (int i = 0; i < 3; ++i) metadata.up[i] = static_cast<float>(s.up[i] / length);
    std::copy_n(s.floor, 3, metadata.floor);
  }
  metadata.audio = text_of(s.audio);
  metadata.audio_begin = metadata.time_base.ticks(s.audio_begin);
  return copy_in_start_view(s.start_view, metadata);
}

Outcome invalid(std::string message) {
  return {STGS_ERROR_ARGUMENT, "fragment: " + std::move(message)};
}

Outcome check(const stgs_fragment& s, std::uint32_t frames) {
  if (s.frames == 0) return invalid("frames is 0 (expected at least 1)");
  constexpr std::uint32_t kMax = std::numeric_limits<std::uint32_t>::max();
  if (std::max(s.frames, s.visible_frames) > kMax - frames) {
    return invalid(fmt::format("{} frames after frame {} exceed the limit of the format",
                               std::max(s.frames, s.visible_frames), frames));
  }
  if (s.count > kMaxPrimitives) {
    return invalid(fmt::format("count is {} (expected at most {})", s.count, kMaxPrimitives));
  }
  const std::pair<const char*, const float*> needed[] = {
      {"position", s.position}, {"scale", s.scale}, {"opacity", s.opacity}, {"sh", s.sh}};
  for (const auto& [name, array] : needed) {
    if (s.count > 0 && array == nullptr)
      return invalid(fmt::format("{} is NULL, but count is not 0", name));
  }
  const bool no_lifespans = s.time == nullptr;
  if ((s.sigma == nullptr) != no_lifespans || (s.radius == nullptr) != no_lifespans) {
    return invalid("only some of time, sigma and radius are set; set all three or none");
  }
  return {};
}

// Checks the values under the names that the caller knows. The recorder checks converted values.
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
    const float* const found = std::find_if_not(array.values, array.values + count,
                                                [](float v) { return std::isfinite(v); });
    if (found == array.values + count) continue;
    const auto at = static_cast<std::size_t>(found - array.values);
    const std::string component =
        array.each > 1 ? fmt::format("[{}]", at % array.each) : std::string();
    return invalid(fmt::format("{}{} of primitive {} is {} (expected a finite number)", array.name,
                               component, at / array.each, *found));
  }
  return {};
}

// Converts the fragment to the representation of the format, in ticks of `seconds`. Skips checks
// that the recorder makes.
Outcome convert_primitives(const stgs_fragment& s, int sh_degree, double seconds,
                           Gaussians4D& set) {
  const auto n = static_cast<std::size_t>(s.count);
  STGS_SDK_TRY(check_finite(s, sh_degree));
  set.sh_degree = sh_degree;
  set.resize(n);
  std::copy_n(s.sh, set.sh.size(), set.sh.begin());
  std::copy_n(s.position, 3 * n, set.position.begin());
  if (s.rotation != nullptr) std::copy_n(s.rotation, 4 * n, set.rotation.begin());
  for (std::size_t i = 0; i < 3 * n; ++i) {
    if (!(s.scale[i] > 0)) {
      return invalid(fmt::format("scale of primitive {} is {} (expected > 0)", i / 3, s.scale[i]));
    }
    set.log_scale[i] = std::log(s.scale[i]);
    if (s.velocity != nullptr) set.velocity[i] = static_cast<float>(s.velocity[i] * seconds);
  }
  // Full opacity from the first frame to beyond the last visible one.
  const auto always = 2.0f * static_cast<float>(std::max(s.frames, s.visible_frames));
  for (std::size_t i = 0; i < n; ++i) {
    if (!(s.opacity[i] >= 0 && s.opacity[i] <= 1)) {
      return invalid(
          fmt::format("opacity of primitive {} is {} (expected 0 to 1)", i, s.opacity[i]));
    }
    const float opacity = std::clamp(s.opacity[i], kMinOpacity, kMaxOpacity);
    set.opacity_logit[i] = std::log(opacity / (1 - opacity));
    if (s.rotation == nullptr) set.rotation[4 * i] = 1;
    set.time[i] = s.time == nullptr ? 0 : static_cast<float>(s.time[i] / seconds);
    set.sigma[i] = s.sigma == nullptr ? always : static_cast<float>(s.sigma[i] / seconds);
    set.radius[i] = s.radius == nullptr ? always : static_cast<float>(s.radius[i] / seconds);
  }
  return {};
}

Outcome copy_in_path_and_settings(const stgs_recorder& recorder, const char* path,
                                  const stgs_record_settings* given,
                                  stgs_record_settings& settings) {
  STGS_SDK_TRY(recorder.check_not_begun());
  STGS_SDK_TRY(check_path("path", path));
  STGS_SDK_TRY(copy_in_settings(given, settings));
  return check(settings);
}

Outcome append(stgs_recorder& to, const stgs_fragment& fragment) {
  SceneRecorder& recorder = *to.recorder;
  STGS_SDK_TRY(check(fragment, recorder.frames()));
  Gaussians4D set;
  STGS_SDK_TRY(convert_primitives(fragment, recorder.sh_degree(),
                                  recorder.metadata().time_base.seconds(1), set));
  std::span<const float> importance;
  if (fragment.importance != nullptr) importance = {fragment.importance, set.size()};
  const std::uint32_t begin = recorder.frames();
  const ScopedTaskRunner use(to.threads.get());
  return recorder.append(set, begin + fragment.frames, importance, begin + fragment.visible_frames);
}

}  // namespace
}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_record_settings_defaults(stgs_record_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, stgs::sdk::default_record_settings());
}

stgs_result stgs_fragment_defaults(stgs_fragment* fragment, size_t struct_size) {
  return stgs::sdk::fill_defaults(fragment, struct_size, stgs::sdk::default_fragment());
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
  return recorder == nullptr ? STGS_ERROR_ARGUMENT : recorder->error.get(error);
}

stgs_result stgs_recorder_begin(stgs_recorder* recorder, const char* path,
                                const stgs_record_settings* settings) {
  using namespace stgs::sdk;
  return guarded(recorder, [&]() -> Outcome {
    stgs_record_settings known = default_record_settings();
    STGS_SDK_TRY(copy_in_path_and_settings(*recorder, path, settings, known));
    stgs::SceneMetadata metadata;
    STGS_SDK_TRY(copy_in_metadata(known, metadata));
    recorder->threads = make_thread_pool(known.threads);
    auto created =
        stgs::SceneRecorder::create(path, metadata, known.sh_degree, recording_of(known));
    if (!created.ok()) return created.status();
    recorder->recorder = std::move(created).value();
    return {};
  });
}

stgs_result stgs_recorder_resume(stgs_recorder* recorder, const char* path,
                                 const stgs_record_settings* settings) {
  using namespace stgs::sdk;
  return guarded(recorder, [&]() -> Outcome {
    stgs_record_settings known = default_record_settings();
    STGS_SDK_TRY(copy_in_path_and_settings(*recorder, path, settings, known));
    recorder->threads = make_thread_pool(known.threads);
    auto created = stgs::SceneRecorder::resume(path, recording_of(known));
    if (!created.ok()) return created.status();
    recorder->recorder = std::move(created).value();
    return {};
  });
}

stgs_result stgs_recorder_append(stgs_recorder* recorder, const stgs_fragment* fragment) {
  using namespace stgs::sdk;
  return guarded(recorder, [&]() -> Outcome {
    STGS_SDK_TRY(recorder->check_recording());
    stgs_fragment known = default_fragment();
    STGS_SDK_TRY(copy_in(fragment, known, "fragment"));
    return append(*recorder, known);
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
    copy_out(status, {sizeof(*status), of.bytes(), of.frames(), time_base.numerator,
                      time_base.denominator, of.sh_degree(), of.primitives(), of.dropped()});
    return {};
  });
}

}  // extern "C"
