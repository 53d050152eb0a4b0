// SPDX-License-Identifier: Apache-2.0
#include "scene.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <utility>

#include "source.h"
#include "stgs/player/source.h"
#include "structs.h"
#include "transfer_settings.h"

using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

stgs_scene_settings default_scene_settings() {
  stgs_scene_settings settings{};
  settings.struct_size = sizeof(settings);
  settings.max_file_bytes = INT64_MAX;
  settings.max_primitives = stgs::ReadLimits{}.max_primitives;
  settings.memory_budget = settings.max_memory = stgs::player::kDefaultMemoryBudget;
  stgs::sdk::fill_transfer_settings(stgs::player::HttpSettings{}, settings);
  return settings;
}

// Returns a message about the first setting that is out of range; empty if there is none.
std::string out_of_range(const stgs_scene_settings& s) {
  for (const auto& [name, bytes] :
       {std::pair{"memory_budget", s.memory_budget}, std::pair{"max_memory", s.max_memory}}) {
    if (bytes >= stgs::sdk::kMinMemoryBudget) continue;
    return fmt::format("settings: {} is too small (expected at least 1 MiB)", name);
  }
  const struct {
    const char* name;
    double value, min, max;
  } ranges[] = {{"url_timeout_seconds", s.url_timeout_seconds, stgs::player::kMinRequestSeconds,
                 stgs::player::kMaxRequestSeconds},
                {"url_min_bytes_per_second", s.url_min_bytes_per_second,
                 stgs::player::kMinBytesPerSecond, stgs::player::kMaxBytesPerSecond}};
  for (const auto& [name, value, min, max] : ranges) {
    if (value >= min && value <= max) continue;  // not NaN
    return fmt::format("settings: {} is {} (expected {} to {})", name, value, min, max);
  }
  return {};
}

Outcome check_closed(const stgs_scene& scene) {
  if (scene.of_player) {
    return {STGS_ERROR_STATE, "the scene belongs to a player; call a stgs_player_open function"};
  }
  if (scene.timeline == nullptr) return {};
  return {STGS_ERROR_STATE, "the scene is already open; create another scene"};
}

Outcome check_file_bytes(const stgs_scene& scene, const std::string& name, std::uint64_t bytes) {
  if (bytes <= scene.settings.max_file_bytes) return {};
  return {STGS_ERROR_LIMIT, fmt::format("{}: the file is too large (limit {} bytes, got {}); raise "
                                        "max_file_bytes",
                                        name, scene.settings.max_file_bytes, bytes)};
}

// Takes ownership of the source in any case.
Outcome open_source(stgs_scene& scene, std::unique_ptr<stgs::ByteSource> source) {
  const stgs_scene_settings& settings = scene.settings;
  const std::string name = source->name();
  STGS_SDK_TRY(check_file_bytes(scene, name, source->size()));
  auto reader = stgs::SceneReader::open(
      std::move(source), stgs::ReadLimits::of(settings.max_primitives, settings.max_memory),
      scene.memory.get());
  if (!reader.ok()) return reader.status();
  auto timeline = stgs::player::Timeline::from_reader(
      std::move(reader).value(), name, settings.memory_budget,
      settings.reject_damage != 0 ? stgs::player::DamagePolicy::kReject
                                  : stgs::player::DamagePolicy::kSkip);
  for (const stgs::Issue& issue : timeline->damage()) {
    if (settings.reject_damage != 0 && issue.error) {
      return stgs::invalid_file("{}: {} (byte {}, issue {})", name, issue.message, issue.offset,
                                issue.number);
    }
  }
  scene.owned = std::move(timeline);
  scene.timeline = scene.owned.get();
  scene.log_issues();
  return {};
}

// Reports retries as the caller's log permits: one at a time, from any thread.
stgs::player::HttpSettings transfer_settings(const stgs_scene& scene) {
  stgs::player::HttpSettings settings;
  stgs::sdk::read_transfer_settings(scene.settings, settings);
  settings.stop = scene.stop.get_token();
  settings.on_event = [log = scene.log, mutex = std::make_shared<std::mutex>()](
                          const stgs::player::TransferEvent& event) {
    // Other events end the transfer, which is the error of the call.
    if (event.kind != stgs::player::TransferEvent::Kind::kRetry) return;
    const std::lock_guard lock(*mutex);
    log(STGS_LOG_INFO, fmt::format("at byte {}: {}; retrying in {:.1f} s", event.offset,
                                   event.message, event.wait_seconds));
  };
  return settings;
}

Outcome check_memory_argument(const stgs_scene& scene, const void* data) {
  STGS_SDK_TRY(check_closed(scene));
  if (data == nullptr) return {STGS_ERROR_ARGUMENT, "data is NULL"};
  return {};
}

template <typename To, typename From>
void copy3(To& to, const From& from) {
  std::copy_n(from, 3, to);
}

}  // namespace

Outcome stgs_scene::with_cancellation(Outcome outcome) const {
  if (outcome.result == STGS_ERROR_RUNTIME && stop.stop_requested()) {
    outcome.result = STGS_ERROR_CANCELLED;
  }
  return outcome;
}

void stgs_scene::log_issues() const {
  for (const stgs::Issue& issue : timeline->damage()) {
    log(STGS_LOG_WARNING, fmt::format("{}: {} (byte {}, issue {})", timeline->name(), issue.message,
                                      issue.offset, issue.number));
  }
}

void stgs_scene::log_new_damage() {
  // Segments are renumbered when a recording gets another index.
  if (std::exchange(logged_for, timeline->identity()) != timeline->identity()) logged_damage = 0;
  const auto& damage = timeline->segment_damage();
  for (; logged_damage < damage.size(); ++logged_damage) {
    const stgs::player::SegmentDamage& one = damage[logged_damage];
    log(STGS_LOG_WARNING,
        fmt::format("{}: segment {} is rendered without {}: {}", timeline->name(), one.segment,
                    one.sh_only ? "view-dependent colour" : "any of its primitives",
                    one.reason.message()));
  }
}

Outcome stgs_scene::clamp_time(double& seconds) const {
  if (!std::isfinite(seconds)) {
    return {STGS_ERROR_ARGUMENT, fmt::format("seconds is {} (expected a finite number)", seconds)};
  }
  const double duration = timeline->duration_seconds();
  const double tolerance = timeline->metadata().time_base.seconds(0.5);
  const bool is_growing = of_player && timeline->reader().form() == stgs::SceneForm::kGrowing;
  if (seconds < -tolerance || (seconds > duration + tolerance && !is_growing)) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("{}: seconds is {:.10g}, outside of the clip (expected 0 to {:.10g})",
                        timeline->name(), seconds, duration)};
  }
  seconds = std::max(seconds, 0.0);
  if (!is_growing) seconds = std::min(seconds, duration);
  return {};
}

Outcome stgs_scene::check_memory(double seconds) {
  if (of_player) return {};
  auto needed = timeline->visible_segments(seconds);
  if (!needed.ok()) return needed.status();
  const int degree = timeline->reader().sh_degree() + 1;
  // Position, scale, rotation, opacity, time, velocity, sigma, radius; SH coefficients.
  const auto floats = static_cast<std::uint64_t>(17 + 3 * degree * degree);
  std::uint64_t bytes = 0;
  for (const auto& one : *needed) {
    const stgs::SegmentInfo& segment = timeline->reader().segments()[one.segment];
    if (segment.available) bytes += segment.primitives * floats * sizeof(float);
  }
  if (bytes <= settings.memory_budget) return {};
  return {STGS_ERROR_LIMIT,
          fmt::format("{}: the primitives active at {:.6g} s need too much memory (limit {} bytes, "
                      "need at least {}); raise memory_budget",
                      timeline->name(), seconds, settings.memory_budget, bytes)};
}

extern "C" {

stgs_result stgs_scene_settings_defaults(stgs_scene_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, default_scene_settings());
}

stgs_result stgs_scene_create(const stgs_scene_settings* settings, stgs_scene** out) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  *out = nullptr;
  stgs_scene_settings known = default_scene_settings();
  if (settings != nullptr) {
    if (const stgs_result bad = stgs::sdk::copy_in(settings, known); bad != STGS_OK) return bad;
  }
  const stgs::sdk::Log log = {known.log, known.log_user};
  if (const std::string wrong = out_of_range(known); !wrong.empty()) {
    log(STGS_LOG_ERROR, wrong);
    return STGS_ERROR_ARGUMENT;
  }
  if (const stgs_result bad = stgs::sdk::check_allocator(known.allocator, log); bad != STGS_OK) {
    return bad;
  }
  try {
    auto scene = std::make_unique<stgs_scene>();
    scene->settings = known;
    scene->log = log;
    scene->memory = stgs::sdk::caller_memory(known.allocator);
    if (known.name != nullptr) scene->name = known.name;
    scene->settings.name = nullptr;  // may not outlive this call
    *out = scene.release();
    return STGS_OK;
  } catch (const std::bad_alloc&) {
    return STGS_ERROR_OUT_OF_MEMORY;
  }
}

void stgs_scene_destroy(stgs_scene* scene) {
  if (scene != nullptr && !scene->of_player) delete scene;
}

void stgs_scene_cancel(stgs_scene* scene) {
  if (scene != nullptr) scene->stop.request_stop();
}

stgs_result stgs_scene_open(stgs_scene* scene, const char* location) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*scene));
    if (location == nullptr) return {STGS_ERROR_ARGUMENT, "location is NULL"};
    auto source = stgs::player::open_location(location, transfer_settings(*scene));
    if (!source.ok()) return scene->with_cancellation(source.status());
    return scene->with_cancellation(open_source(*scene, std::move(source).value()));
  });
}

stgs_result stgs_scene_open_memory(stgs_scene* scene, const void* data, size_t bytes) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(check_memory_argument(*scene, data));
    return open_source(*scene, stgs::sdk::borrowed_source(
                                   {static_cast<const std::uint8_t*>(data), bytes}, scene->name));
  });
}

stgs_result stgs_scene_open_memory_copy(stgs_scene* scene, const void* data, size_t bytes) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(check_memory_argument(*scene, data));
    const std::string name = scene->name.empty() ? "memory" : scene->name;
    STGS_SDK_TRY(check_file_bytes(*scene, name, bytes));  // before copying
    return open_source(*scene,
                       stgs::sdk::copied_source({static_cast<const std::uint8_t*>(data), bytes},
                                                scene->memory, name));
  });
}

stgs_result stgs_scene_open_io(stgs_scene* scene, const stgs_io* io) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*scene));
    stgs_io known{};
    STGS_SDK_TRY(stgs::sdk::copy_in(io, known, "io"));
    if (known.read == nullptr) return {STGS_ERROR_ARGUMENT, "io->read is NULL"};
    return open_source(*scene, stgs::sdk::callback_source(known, scene->name).source);
  });
}

stgs_result stgs_scene_error(const stgs_scene* scene, stgs_error* error) {
  return scene == nullptr ? STGS_ERROR_ARGUMENT : scene->error.get(error);
}

stgs_result stgs_scene_get_info(stgs_scene* scene, stgs_scene_info* info) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    STGS_SDK_TRY(stgs::sdk::check_struct(info, "info"));
    const stgs::player::Timeline& timeline = *scene->timeline;
    const stgs::SceneReader& reader = timeline.reader();
    const stgs::SceneMetadata& metadata = timeline.metadata();
    stgs_scene_info out{};
    out.struct_size = sizeof(out);
    out.format_major = reader.version_major();
    out.format_minor = reader.version_minor();
    out.frames = metadata.frames;
    out.time_base_numerator = metadata.time_base.numerator;
    out.time_base_denominator = metadata.time_base.denominator;
    out.duration_seconds = timeline.duration_seconds();
    out.complete_seconds = timeline.complete_seconds();
    out.primitives = reader.primitives();
    out.file_bytes = reader.file_bytes();
    out.memory_bytes = timeline.memory_bytes();
    out.sh_degree = reader.sh_degree();
    out.has_start_camera = metadata.start_camera ? 1 : 0;
    copy3(out.bounds_min, metadata.bounds_min);
    copy3(out.bounds_max, metadata.bounds_max);
    out.metres_per_unit = metadata.metres_per_unit;
    copy3(out.up, metadata.up);
    copy3(out.floor, metadata.floor);
    out.issues = static_cast<std::uint32_t>(timeline.damage().size());
    out.near_plane = metadata.near_plane;
    copy3(out.background, metadata.background);
    out.audio_begin_seconds = metadata.time_base.seconds(metadata.audio_begin);
    out.colour_primaries = metadata.primaries;
    out.transfer_function = metadata.transfer;
    out.kernel = metadata.kernel == stgs::math::kBandLimited ? 1 : 0;
    stgs::sdk::copy_out(info, out);
    return {};
  });
}

stgs_result stgs_scene_get_text(stgs_scene* scene, stgs_text which, const char** out) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    if (out == nullptr) return {STGS_ERROR_ARGUMENT, "out is NULL"};
    const stgs::SceneMetadata& metadata = scene->timeline->metadata();
    switch (which) {
      case STGS_TEXT_TITLE:
        *out = scene->intern(metadata.title);
        return {};
      case STGS_TEXT_GENERATOR:
        *out = scene->intern(metadata.generator);
        return {};
      case STGS_TEXT_AUDIO:
        *out = scene->intern(metadata.audio);
        return {};
      case STGS_TEXT_PROFILE:
        *out = stgs::profile_name(scene->timeline->reader().profile());
        return {};
      case STGS_TEXT_NAME:
        *out = scene->intern(scene->timeline->name());
        return {};
      default:
        return {STGS_ERROR_ARGUMENT, fmt::format("which: unknown text {}", which)};
    }
  });
}

stgs_result stgs_scene_get_issue(stgs_scene* scene, uint32_t index, stgs_issue* issue) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    STGS_SDK_TRY(stgs::sdk::check_struct(issue, "issue"));
    const auto& issues = scene->timeline->damage();
    if (index >= issues.size()) {
      return {STGS_ERROR_ARGUMENT,
              fmt::format("index: out of range (stgs_scene_info.issues is {}, got {})",
                          issues.size(), index)};
    }
    const stgs::Issue& found = issues[index];
    stgs::sdk::copy_out(issue, {sizeof(*issue), found.number, found.error ? 1 : 0, found.offset,
                                scene->intern(found.message)});
    return {};
  });
}

}  // extern "C"
