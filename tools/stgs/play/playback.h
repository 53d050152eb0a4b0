// SPDX-License-Identifier: Apache-2.0
// A player with the controls of the player window: opened in the background, with pause, frame
// steps, rates and notices.
#pragma once

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "session.h"
#include "stgs/stgs.h"

namespace stgs::tools {

struct PlaybackSettings {
  std::string file;  // path or URL
  double seconds = 0, rate = 1;
  bool paused = false, loop = false;
  std::uint64_t memory = std::uint64_t{4} << 30;  // bytes, at least 1 MiB
};

// Not thread-safe. The session must outlive this. The destructor cancels transfers.
class Playback {
 public:
  static constexpr double kRates[] = {-2, -1, -0.5, -0.25, 0.25, 0.5, 1, 2, 4};

  // Starts to open the file, in the background.
  static Result<std::unique_ptr<Playback>> start(Session& session,
                                                 const PlaybackSettings& settings);
  // Used by start().
  Playback(Session& session, const PlaybackSettings& settings)
      : session_(session), settings_(settings) {}

  // Returns whether the file is open at `now`, in seconds of any clock. An error if it cannot be
  // opened. The functions below are valid once it is open.
  Result<bool> is_open(double now);
  // Advances playback to `now`, of the same clock. Returns the time to render. kIo if reads have
  // failed and nothing could be shown for --timeout since the file is open; later, failed reads are
  // retried without end.
  Result<double> advance(double now);

  stgs_scene* scene() const { return stgs_player_scene(player_.get()); }
  // The metadata as of the last advance().
  const stgs_scene_info& info() const { return info_; }
  // The status as of the last advance() or control.
  const stgs_player_status& status() const { return status_; }
  double seconds() const { return status_.seconds; }
  bool is_playing() const;
  double rate() const { return rate_; }
  bool loops() const { return loop_; }
  double duration() const { return info_.duration_seconds; }
  std::uint32_t frame() const;
  double bits_per_second() const;  // mean of the file; 0 for a single frame
  stgs_player_statistics statistics() const;
  std::uint64_t memory_budget() const { return settings_.memory; }  // bytes
  // Returns the ranges of clip time that play without stalling, ascending.
  std::vector<stgs_time_range> buffered() const;
  double buffered_ahead() const;  // seconds, in the direction of playback
  // Returns whether loading of the current time has ended, successfully or not.
  bool is_loaded() const { return status_.is_complete != 0; }
  // Returns whether all layers of the current time are resident.
  bool is_complete() const { return status_.ready != 0 && status_.layers >= status_.layer_count; }

  void toggle_pause();
  void step(int frames);  // pauses
  void seek(double seconds);
  void change_rate(int by);  // to the next higher or lower rate in kRates
  void toggle_loop();

  // Adds a line to notices() and logs it as a warning.
  void warn(double now, const std::string& text);
  // Returns the recent warnings, oldest first.
  std::vector<std::string> notices(double now);
  std::uint64_t stalls() const { return stalls_; }

 private:
  struct Destroy {
    void operator()(stgs_player* player) const { stgs_player_destroy(player); }
  };
  Status create();
  Status begin();
  Status update_info();
  // Converts the result of a call on the player.
  Status check(stgs_result result) const;
  // Ends a control: logs its error, which only a lack of memory causes, and updates the status.
  void control(stgs_result result);
  stgs_player_live live() const;
  void set_rate(double rate);
  Result<stgs_player_event> next_event();
  Status take_events(double now);
  Status take_opening_events();
  Status skip_opening_damage();
  void report(double now, const stgs_player_event& event);
  Status check_start(double now);

  Session& session_;
  const PlaybackSettings settings_;
  std::unique_ptr<stgs_player, Destroy> player_;
  bool is_open_ = false;
  stgs_player_status status_{};
  stgs_scene_info info_{};
  double rate_ = 1;
  bool loop_ = false;
  std::uint64_t stalls_ = 0;
  double opened_at_ = 0;     // of the clock of is_open()
  bool has_shown_ = false;   // some layer of some time was resident
  std::string failed_read_;  // message of the last; empty: none
  struct Notice {
    double when;
    std::string text;
  };
  std::deque<Notice> notices_;
};

}  // namespace stgs::tools
