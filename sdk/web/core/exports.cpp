// SPDX-License-Identifier: Apache-2.0
// The functions that the host calls (sdk/web/src/core/module.ts). An instance of the module has one
// player, on one thread.
#include <cmath>
#include <cstdint>
#include <exception>
#include <memory>
#include <span>
#include <string>

#include <fmt/format.h>
#include "export.h"
#include "web_player.h"

namespace {

using namespace stgs;
using web::give, web::quoted;

std::unique_ptr<web::WebPlayer> current;
web::WebPlayer::Change change;

// Returns a JSON number, or null if it is not finite.
std::string number(double value) {
  return std::isfinite(value) ? fmt::format("{}", value) : "null";
}

std::string numbers(std::span<const float> values) {
  std::string out = "[";
  for (const float value : values) out += (out.size() > 1 ? "," : "") + number(value);
  return out + "]";
}

std::string counts(std::span<const std::uint64_t> values) {
  std::string out;
  for (const std::uint64_t value : values)
    out += fmt::format("{}{}", out.empty() ? "" : ",", value);
  return out;
}

std::string camera_json(const SceneMetadata& scene) {
  if (!scene.start_camera) return "null";
  const StartCamera& c = *scene.start_camera;
  return fmt::format(
      R"({{"rotation":{},"translation":{},"fx":{},"fy":{},"cx":{},"cy":{},"width":{},"height":{},"near":{}}})",
      numbers(c.rotation), numbers(c.translation), number(c.fx), number(c.fy), number(c.cx),
      number(c.cy), c.width, c.height, number(scene.near_plane));
}

std::string duration_of(const SceneReader& reader) {
  return number(reader.metadata().time_base.seconds(reader.metadata().frames));
}

// Returns the state of a growing recording, or null. `stable`: bytes that the file keeps.
std::string live_json() {
  const player::LiveState live = current->player().live();
  if (!live.growing) return "null";
  return fmt::format(R"({{"following":{},"latency":{},"targetLatency":{},"stable":{}}})",
                     live.following, number(live.latency_seconds),
                     number(live.target_latency_seconds), current->reader().file_bytes());
}

const char* state_name(player::PlayerState state) {
  switch (state) {
    case player::PlayerState::kPlaying:
      return "playing";
    case player::PlayerState::kBuffering:
      return "buffering";
    case player::PlayerState::kEnded:
      return "ended";
    case player::PlayerState::kPaused:
      break;
  }
  return "paused";
}

const char* event_name(player::PlayerEvent::Kind kind) {
  using Kind = player::PlayerEvent::Kind;
  switch (kind) {
    case Kind::kBuffering:
      return "buffering";
    case Kind::kResumed:
      return "resumed";
    case Kind::kLooped:
      return "looped";
    case Kind::kEnded:
      return "ended";
    case Kind::kLayers:
      return "layers";
    case Kind::kRetry:
      return "retry";
    case Kind::kReadFailed:
      return "read-failed";
    case Kind::kDamaged:
      return "damaged";
    case Kind::kReplaced:
      return "replaced";
    case Kind::kStalled:
      return "stalled";
    case Kind::kSkipped:
      return "skipped";
    case Kind::kFinished:
      break;
  }
  return "finished";
}

}  // namespace

// Returns memory for `bytes` bytes, which stgs_free() frees; null if there is none.
STGS_EXPORT void* stgs_allocate(std::uint32_t bytes) {
  return std::malloc(bytes);
}
STGS_EXPORT void stgs_free(void* memory) {
  std::free(memory);
}

// Creates the player of a file. `follows`: whether the file may grow; `latency`: as
// stgs_set_latency(); `max_primitives`: as stgs_limit_primitives(); `prefetch`: seconds to fetch
// ahead; `decodes`: segments that the host decodes at a time.
STGS_EXPORT void stgs_create(const char* name, double file_bytes, bool follows, double latency,
                             double memory_budget, double max_primitives, double prefetch,
                             int decodes) {
  current = std::make_unique<web::WebPlayer>(name, static_cast<std::uint64_t>(file_bytes), follows,
                                             latency, static_cast<std::uint64_t>(memory_budget),
                                             static_cast<std::uint64_t>(max_primitives), prefetch,
                                             decodes);
}

// Opens the file. Returns its description as JSON, {"missing": [offset, bytes]} if bytes must be
// provided first, or {"code": status code, "message": text}.
STGS_EXPORT const char* stgs_open() {
  Status status;
  try {
    status = current->open();
  } catch (const std::exception& e) {
    status = Status(code_of(e), e.what());
  }
  if (const auto& missing = current->source().missing(); !status.ok() && missing)
    return give(fmt::format(R"({{"missing":[{},{}]}})", missing->offset, missing->bytes));
  if (!status.ok()) {
    return give(fmt::format(R"({{"code":{},"message":{}}})", static_cast<int>(status.code()),
                            quoted(status.message())));
  }
  const SceneReader& reader = current->reader();
  const SceneMetadata& scene = reader.metadata();
  return give(fmt::format(
      R"({{"info":{{"duration":{},"tickSeconds":{},"frames":{},"shDegree":{},"primitives":{},)"
      R"("kernel":{},"boundsMin":{},"boundsMax":{},"background":{},"up":{},"metresPerUnit":{},)"
      R"("floor":{},"startCamera":{},"title":{},"tierPrimitives":[{}],"audio":{},"audioBegin":{}}}}})",
      duration_of(reader), number(scene.time_base.seconds(1)), scene.frames, reader.sh_degree(),
      reader.primitives(), scene.kernel == math::kBandLimited ? 1 : 0, numbers(scene.bounds_min),
      numbers(scene.bounds_max), numbers(scene.background), numbers(scene.up),
      number(scene.metres_per_unit), numbers(scene.floor), camera_json(scene), quoted(scene.title),
      counts(current->player().tier_peaks()), quoted(scene.audio),
      number(scene.time_base.seconds(scene.audio_begin))));
}
// Returns memory for bytes of the file from `offset` on, for the next stgs_open().
STGS_EXPORT std::uint8_t* stgs_provide(double offset, std::uint32_t bytes) {
  return current->source().provide(static_cast<std::uint64_t>(offset), bytes).data();
}

// Commands, once the file is open.
STGS_EXPORT void stgs_play() {
  current->player().play();
}
STGS_EXPORT void stgs_pause() {
  current->player().pause();
}
// The following return whether the value is valid; otherwise they change nothing.
STGS_EXPORT bool stgs_seek(double seconds) {
  return current->player().seek(seconds).ok();
}
STGS_EXPORT bool stgs_set_rate(double rate) {
  return current->player().set_rate(rate).ok();
}
// Sets the minimum latency behind the live edge, seconds, finite and at least 0.
STGS_EXPORT bool stgs_set_latency(double seconds) {
  return current->player().set_live_latency(seconds).ok();
}
STGS_EXPORT void stgs_set_loop(bool loop) {
  current->player().set_loop(loop);
}

// Limits the primitives at one time (StreamPlayer::limit_primitives()), at most 2^53.
STGS_EXPORT void stgs_limit_primitives(double max_primitives) {
  current->player().limit_primitives(static_cast<std::uint64_t>(max_primitives));
}

// Makes progress (WebPlayer::step()). `now`: seconds of a monotonic clock.
STGS_EXPORT double stgs_step(double now, double budget) {
  return current->step(now, budget);
}
// Ends a read that stgs_host_read() began. `failure`: why it failed, empty: it has succeeded.
// `file_bytes`: the size of the file.
STGS_EXPORT void stgs_read_done(std::uint32_t id, const char* failure, double file_bytes,
                                double now) {
  current->read_done(id, failure, static_cast<std::uint64_t>(file_bytes), now);
}

// Ends the decoding that stgs_host_decode() began; codes are those of Status, messages may be
// empty.
STGS_EXPORT void stgs_decode_done(std::uint32_t id, double time_origin, int base_code,
                                  const char* base_message, int sh_code, const char* sh_message) {
  current->executor().done(id, time_origin,
                           Status(static_cast<StatusCode>(base_code), base_message),
                           Status(static_cast<StatusCode>(sh_code), sh_message));
}
// Returns the id of a decoding whose parts are no longer needed, once; 0: there is none.
STGS_EXPORT std::uint32_t stgs_take_released() {
  return current->executor().take_released();
}

// Returns the state as JSON.
STGS_EXPORT const char* stgs_state() {
  player::StreamPlayer& p = current->player();
  std::string ranges;
  for (const player::TimeRange& range : current->buffered())
    ranges += fmt::format("{}[{},{}]", ranges.empty() ? "" : ",", range.begin, range.end);
  const player::StreamStatistics statistics = p.statistics();
  return give(fmt::format(
      R"({{"state":"{}","seconds":{},"duration":{},"live":{},"buffered":[{}],"layers":{},)"
      R"("layerCount":{},"tierPrimitives":[{}],"bytes":{},"memory":{},"bytesPerSecond":{}}})",
      state_name(p.state()), p.seconds(), duration_of(current->reader()), live_json(), ranges,
      p.layers(), p.layer_count(), counts(p.tier_peaks()), statistics.fetched_bytes,
      statistics.memory_bytes, number(statistics.bytes_per_second)));
}
// Returns the events since the last call as a JSON array.
STGS_EXPORT const char* stgs_events() {
  std::string out = "[";
  for (const player::PlayerEvent& event : current->player().take_events()) {
    out += fmt::format(R"({}{{"kind":"{}","seconds":{},"message":{}}})", out.size() > 1 ? "," : "",
                       event_name(event.kind), event.seconds, quoted(event.message));
  }
  return give(out + "]");
}

// Moves on to the next change of the segments that the page should hold; false: there is none. The
// following describe it.
STGS_EXPORT bool stgs_next_change() {
  const auto next = current->next_change();
  if (next) change = *next;
  return next.has_value();
}
STGS_EXPORT std::uint32_t stgs_change_segment() {
  return change.segment;
}
// The id of its decoding; 0: it is no longer needed.
STGS_EXPORT std::uint32_t stgs_change_decoded() {
  return change.decoded;
}
STGS_EXPORT double stgs_change_begin() {
  return change.begin;
}
STGS_EXPORT double stgs_change_end() {
  return change.end;
}
STGS_EXPORT double stgs_change_origin() {
  return change.origin;
}
