// SPDX-License-Identifier: Apache-2.0
/// @file
/// C++17 wrapper of stgs_player.h; stgs.hpp includes it. Header-only.
#ifndef STGS_STGS_PLAYER_HPP
#define STGS_STGS_PLAYER_HPP

#include "stgs/stgs.hpp"

namespace stgs {
inline namespace hpp {

/// @addtogroup api_cpp
/// @{

/// An stgs_player_event that owns its message.
struct PlayerEvent {
  stgs_event_kind kind = STGS_EVENT_NONE;  ///< kind of the event
  stgs_result result = STGS_OK;            ///< STGS_OK unless the event describes a failure
  double seconds = 0;                      ///< playback time
  std::uint64_t offset = STGS_NO_OFFSET;   ///< position in the file, bytes
  std::int32_t layers = 0;                 ///< available layers, for STGS_EVENT_LAYERS
  std::string message;                     ///< empty unless the event describes a failure
};

/// Plays a scene while its data is still arriving.
class Player {
 public:
  /// Creates a player without a file.
  explicit Player(const stgs_player_settings& settings = player_settings()) {
    stgs_player* player = nullptr;
    check(stgs_player_create(&settings, &player));
    player_.reset(player);
  }
  /// Returns the C object, which this object owns.
  stgs_player* get() const { return player_.get(); }
  /// Returns the scene of the player, for its metadata and for rendering.
  SceneRef scene() const { return SceneRef(stgs_player_scene(get())); }

  /// Starts to open a path, or an http or https URL.
  void open(const std::string& location) {
    check(stgs_player_open(get(), location.c_str()), get());
  }
  /// Starts to open a file in memory without copying it; the bytes must outlive the player.
  void open_memory(Span<const std::uint8_t> bytes) {
    check(stgs_player_open_memory(get(), bytes.data(), bytes.size()), get());
  }
  /// Starts to open a copy of a file in memory.
  void open_memory_copy(Span<const std::uint8_t> bytes) {
    check(stgs_player_open_memory_copy(get(), bytes.data(), bytes.size()), get());
  }
  /// Starts to open a data source with blocking reads.
  void open(const stgs_io& io) { check(stgs_player_open_io(get(), &io), get()); }
  /// Starts to open a data source that completes reads later.
  void open(const stgs_async_io& io) { check(stgs_player_open_async_io(get(), &io), get()); }
  /// Blocks until opening has ended; throws if it failed.
  void wait_open() { check(stgs_player_wait_open(get()), get()); }

  /// Plays from the current time, or from the start if the end is reached.
  void play() { check(stgs_player_play(get()), get()); }
  /// Pauses at the current time.
  void pause() { check(stgs_player_pause(get()), get()); }
  /// Moves to a time.
  void seek(double seconds) { check(stgs_player_seek(get(), seconds), get()); }
  /// Pauses, moves to a time and blocks until it is complete, see stgs_player_seek_and_wait. Throws
  /// STGS_ERROR_TIMEOUT if that takes longer than timeout_seconds.
  stgs_player_status seek_and_wait(double seconds, double timeout_seconds) {
    auto status = detail::sized<stgs_player_status>();
    check(stgs_player_seek_and_wait(get(), seconds, timeout_seconds, &status), get());
    return status;
  }
  /// Moves to the start of a frame.
  void seek_frame(std::uint32_t frame) { check(stgs_player_seek_frame(get(), frame), get()); }
  /// Sets the playback rate: -2 to 4, not 0.
  void set_rate(double rate) { check(stgs_player_set_rate(get(), rate), get()); }
  /// Sets whether playback continues at the other end of the clip.
  void set_loop(bool loop) { check(stgs_player_set_loop(get(), loop ? 1 : 0), get()); }

  /// Moves to the edge of a growing recording and follows it.
  void go_live() { check(stgs_player_go_live(get()), get()); }
  /// Returns the position of playback in a recording.
  stgs_player_live live() const {
    auto live = detail::sized<stgs_player_live>();
    check(stgs_player_get_live(get(), &live), get());
    return live;
  }

  /// Advances the player to `now`, seconds of any clock, and returns its status.
  stgs_player_status update(double now) {
    auto status = detail::sized<stgs_player_status>();
    check(stgs_player_update(get(), now, &status), get());
    return status;
  }
  /// Returns the status without advancing the player.
  stgs_player_status status() const {
    auto status = detail::sized<stgs_player_status>();
    check(stgs_player_get_status(get(), &status), get());
    return status;
  }
  /// Returns the oldest queued event, or nothing.
  std::optional<PlayerEvent> next_event() {
    auto event = detail::sized<stgs_player_event>();
    check(stgs_player_next_event(get(), &event), get());
    if (event.kind == STGS_EVENT_NONE) return {};
    return PlayerEvent{event.kind,   event.result, event.seconds,
                       event.offset, event.layers, event.message};
  }
  /// Returns transfer and memory statistics.
  stgs_player_statistics statistics() const {
    auto statistics = detail::sized<stgs_player_statistics>();
    check(stgs_player_get_statistics(get(), &statistics), get());
    return statistics;
  }
  /// Returns the ranges of clip time in which playback does not stall, ascending.
  std::vector<stgs_time_range> buffered() const {
    std::vector<stgs_time_range> ranges(8);
    for (;;) {
      std::uint32_t count = 0;
      check(stgs_player_get_buffered(get(), ranges.data(),
                                     static_cast<std::uint32_t>(ranges.size()), &count),
            get());
      const bool complete = count <= ranges.size();
      ranges.resize(count);
      if (complete) return ranges;
    }
  }

 private:
  std::unique_ptr<stgs_player, detail::Destroy> player_;
};

/// @}

}  // namespace hpp
}  // namespace stgs

#endif
