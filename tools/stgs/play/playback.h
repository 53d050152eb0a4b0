// SPDX-License-Identifier: Apache-2.0
// A player as a viewer handles it: opened beside the window, with pause, steps and speeds, and what
// there is to tell of it.
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

// One thread. The session outlives it; the destructor ends transfers.
class Playback {
 public:
  static constexpr double kRates[] = {-2, -1, -0.5, -0.25, 0.25, 0.5, 1, 2, 4};

  // Begins to open the file, on a thread of its own.
  Playback(Session& session, const PlaybackSettings& settings);
  ~Playback();
  Playback(const Playback&) = delete;
  Playback& operator=(const Playback&) = delete;

  // Whether the file is open; an error where it cannot be opened or begun.
  Result<bool> is_open();
  // Once it is: the player.
  player::Player& player() { return *player_; }
  // Goes on to `now`, seconds of any clock; the moment to draw.
  double advance(double now);

  bool is_playing() const;
  double rate() const { return rate_; }
  bool loops() const { return loop_; }
  double duration() const;  // seconds
  std::uint32_t frame() const;
  double bits_per_second() const;  // of the file, mean; 0 of a single frame
  double buffered_ahead() const;   // seconds, in the direction of play
  // Whether nothing more of the moment is coming, and whether all of it is there.
  bool is_settled() const { return player_->is_complete(); }
  bool is_whole() const;

  void toggle_pause();
  void step(int frames);  // pauses
  void seek(double seconds);
  void change_rate(int by);  // to a neighbour in kRates
  void toggle_loop();

  // Adds a line to notices(), and warns.
  void warn(double now, const std::string& text);
  // Lines about what went wrong of late, oldest first.
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
  std::vector<player::PlayerEvent> opening_events_;  // that are still to be told
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
