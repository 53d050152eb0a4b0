// SPDX-License-Identifier: Apache-2.0
// A clip in memory, application sources that stall and fail, and helpers for players of the C API.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <functional>
#include <thread>
#include <utility>

#include "deferred_source.h"
#include "sdk_fixture.h"

namespace stgs::testing {

inline constexpr std::uint32_t kClipFrames = 60;  // 2 s

// Several tiers with separate SH layers; segments last 0.2 s or longer.
inline const std::vector<std::uint8_t>& clip_file() {
  static const std::vector<std::uint8_t> file = [] {
    Scene scene = random_scene(2000, 1, kClipFrames, 3);
    for (float& s : scene.gaussians.log_scale) s += 1.0f;
    WriteSettings settings;
    settings.profile = Profile::kQuantised;
    settings.chunk_seconds = 0.2;
    auto bytes = encode_scene(scene, settings);
    REQUIRE(bytes.ok());
    return std::move(bytes).value();
  }();
  return file;
}

// The bytes before the first segment, which are read when the file is opened.
inline std::uint64_t head_bytes_of(const std::vector<std::uint8_t>& file) {
  auto reader = SceneReader::open(memory_source(file));
  REQUIRE(reader.ok());
  std::uint64_t first = file.size();
  for (const SegmentInfo& segment : (*reader)->segments()) first = std::min(first, segment.offset);
  return first;
}

struct DestroyPlayer {
  void operator()(stgs_player* player) const { stgs_player_destroy(player); }
};
using PlayerPtr = std::unique_ptr<stgs_player, DestroyPlayer>;

inline stgs_player_settings player_settings() {
  stgs_player_settings settings;
  REQUIRE(stgs_player_settings_defaults(&settings, sizeof settings) == STGS_OK);
  return settings;
}
inline PlayerPtr make_player(const stgs_player_settings* settings = nullptr) {
  stgs_player* player = nullptr;
  REQUIRE(stgs_player_create(settings, &player) == STGS_OK);
  return PlayerPtr(player);
}
inline PlayerPtr open_player(const std::vector<std::uint8_t>& file,
                             const stgs_player_settings* settings = nullptr) {
  PlayerPtr player = make_player(settings);
  REQUIRE(stgs_player_open_memory(player.get(), file.data(), file.size()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  return player;
}

inline stgs_error error_of(const stgs_player* player) {
  stgs_error error{};
  error.struct_size = sizeof error;
  REQUIRE(stgs_player_error(player, &error) == STGS_OK);
  return error;
}
inline stgs_player_status update(stgs_player* player, double now) {
  stgs_player_status status{};
  status.struct_size = sizeof status;
  REQUIRE(stgs_player_update(player, now, &status) == STGS_OK);
  return status;
}

// An event with a copy of its message, which the library keeps valid only until the next event.
struct OwnedEvent {
  stgs_player_event event;
  std::string message;
};
inline std::vector<OwnedEvent> take_events(stgs_player* player) {
  std::vector<OwnedEvent> out;
  for (;;) {
    stgs_player_event event{};
    event.struct_size = sizeof event;
    REQUIRE(stgs_player_next_event(player, &event) == STGS_OK);
    if (event.kind == STGS_EVENT_NONE) return out;
    out.push_back({event, event.message});
  }
}

// Polls until `holds()` returns true; returns false after 60 s.
inline bool wait_until(const std::function<bool()>& holds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!holds()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}
inline int count_events(const std::vector<OwnedEvent>& events, stgs_event_kind kind) {
  return static_cast<int>(std::count_if(events.begin(), events.end(),
                                        [&](const OwnedEvent& e) { return e.event.kind == kind; }));
}

// Updates at one fixed time until `holds(status)`; returns false after 60 s.
inline bool update_until(stgs_player* player, double now,
                         const std::function<bool(const stgs_player_status&)>& holds) {
  return wait_until([&] { return holds(update(player, now)); });
}
inline bool wait_until_complete(stgs_player* player, double now) {
  return update_until(player, now, [](const stgs_player_status& s) { return s.is_complete != 0; });
}

// An application source, blocking or asynchronous, with injected stalls and errors. Thread-safe.
class FaultySource {
 public:
  explicit FaultySource(const std::vector<std::uint8_t>& bytes) : bytes_(bytes) {}

  stgs_io io() {
    stgs_io io{};
    io.struct_size = sizeof io;
    io.user = this;
    io.size = bytes_.size();
    io.read = [](void* user, std::uint64_t offset, void* out, std::size_t bytes) {
      return static_cast<FaultySource*>(user)->read(offset, out, bytes);
    };
    io.interrupt = [](void* user) { static_cast<FaultySource*>(user)->interrupt(); };
    io.close = [](void* user) { ++static_cast<FaultySource*>(user)->closed; };
    return io;
  }
  stgs_async_io async_io() {
    stgs_async_io io{};
    io.struct_size = sizeof io;
    io.user = this;
    io.size = bytes_.size();
    io.begin = [](void* user, stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
      static_cast<FaultySource*>(user)->begin(read, offset, out, bytes);
    };
    io.interrupt = [](void* user) { static_cast<FaultySource*>(user)->interrupt(); };
    io.close = [](void* user) { ++static_cast<FaultySource*>(user)->closed; };
    return io;
  }

  // Completes the stalled asynchronous reads on the calling thread.
  void complete(int error_code = 0) { stalled_.complete(error_code); }
  std::size_t pending() { return stalled_.pending(); }

  // The number of the first read that stalls: until interrupt() if blocking, until complete() if
  // asynchronous.
  std::atomic<int> stall_from{1 << 30};
  // The result of reads that do not stall and begin at or after the byte `error_from`.
  std::atomic<int> error{0};
  std::atomic<std::uint64_t> error_from{0};
  std::atomic<int> reads{0}, closed{0}, interrupted{0};

 private:
  int read(std::uint64_t offset, void* out, std::size_t bytes) {
    if (reads++ >= stall_from) {
      interrupted.wait(0);
      return 1;
    }
    const int failed = error_at(offset);
    if (failed == 0) std::memcpy(out, bytes_.data() + offset, bytes);
    return failed;
  }
  int error_at(std::uint64_t offset) const { return offset >= error_from ? error.load() : 0; }

  void begin(stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
    if (reads++ >= stall_from) return stalled_.begin(read, offset, out, bytes);
    const int failed = error_at(offset);
    if (failed == 0) std::memcpy(out, bytes_.data() + offset, bytes);
    stgs_read_complete(read, failed);
  }
  void interrupt() {
    ++interrupted;
    interrupted.notify_all();
  }

  const std::vector<std::uint8_t>& bytes_;
  DeferredSource stalled_{bytes_};
};

// Renders the current time of a player.
inline std::vector<std::uint8_t> render_current(stgs_renderer* renderer, stgs_player* player,
                                                const stgs_view& view) {
  return render_rgba8(renderer, stgs_player_scene(player), update(player, 0).seconds, view);
}

}  // namespace stgs::testing
