// SPDX-License-Identifier: Apache-2.0
// A player with the controls of the player window: opened in the background, with pause, frame
// steps, rates and notices.
#pragma once

#include <deque>
#include <future>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <vector>

#include "session.h"
#include "stgs/player/player.h"

namespace stgs::tools {

struct PlaybackSettings {
  std::string file;  // path or URL
  double seconds = 0, rate = 1;
  bool paused = false, loop = false;
  std::uint64_t memory = player::kDefaultMemoryBudget;  // bytes
};

// Not thread-safe. The session must outlive this. The destructor cancels transfers.
class Playback {
 public:
  static constexpr double kRates[] = {-2, -1, -0.5, -0.25, 0.25, 0.5, 1, 2, 4};

  // Starts to open the file, on another thread.
  Playback(Session& session, const PlaybackSettings& settings);
  ~Playback();
  Playback(const Playback&) = delete;
  Playback& operator=(const Playback&) = delete;

  // Returns whether the file is open. An error if it cannot be opened or played.
  Result<bool> is_open();
  // The player. Valid once is_open() has returned true.
  player::Player& player() { return *player_; }
  // Advances playback to `now`, in seconds of any clock. Returns the time to render.
  double advance(double now);

  bool is_playing() const;
  double rate() const { return rate_; }
  bool loops() const { return loop_; }
  double duration() const;  // seconds
  std::uint32_t frame() const;
  double bits_per_second() const;  // mean of the file; 0 for a single frame
  double buffered_ahead() const;   // seconds, in the direction of playback
  // Returns whether loading of the current time has ended, successfully or not.
  bool is_loaded() const { return player_->is_complete(); }
  // Returns whether all layers of the current time are resident.
  bool is_complete() const;

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
  Status begin();
  void take_events(double now);
  void set_rate(double rate);

  Session& session_;
  const PlaybackSettings settings_;
  std::stop_source stop_;
  std::mutex opening_mutex_;
  std::vector<player::PlayerEvent> opening_events_;  // not yet reported
  std::future<Result<std::unique_ptr<player::Player>>> opening_;
  std::unique_ptr<player::Player> player_;
  double rate_ = 1;
  bool loop_ = false;
  std::uint64_t stalls_ = 0;
  struct Notice {
    double when;
    std::string text;
  };
  std::deque<Notice> notices_;
};

}  // namespace stgs::tools
