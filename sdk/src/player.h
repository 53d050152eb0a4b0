// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <vector>

#include "scene.h"
#include "stgs/player/player.h"
#include "tasks.h"

struct stgs_player {
  // Its message is what stgs_player_event points to.
  struct Event {
    stgs_player_event event{};
    std::string message;
  };
  // The last STGS_MAX_EVENTS that nobody has taken. Has its memory from the beginning, so that
  // having none can be told.
  class Events {
   public:
    Events() : slots_(STGS_MAX_EVENTS) {}
    bool empty() const { return count_ == 0; }
    // The oldest makes room for one that is too many.
    void add(Event event) noexcept {
      slots_[(first_ + count_) % slots_.size()] = std::move(event);
      if (count_ < slots_.size()) {
        ++count_;
      } else {
        first_ = (first_ + 1) % slots_.size();
      }
    }
    // The oldest; there must be one.
    Event take() noexcept {
      Event event = std::move(slots_[first_]);
      first_ = (first_ + 1) % slots_.size();
      --count_;
      return event;
    }

   private:
    std::vector<Event> slots_;
    std::size_t first_ = 0, count_ = 0;
  };
  using Opened = stgs::Result<std::unique_ptr<stgs::player::Player>>;

  stgs_player();
  ~stgs_player();
  stgs_player(const stgs_player&) = delete;
  stgs_player& operator=(const stgs_player&) = delete;

  stgs::sdk::LastError error;
  stgs_player_settings settings{};
  stgs_scene scene;
  std::unique_ptr<stgs::TaskRunner> tasks;  // null: threads of the library's
  // What the file is opened with, and what ends the reads of it at once.
  stgs::player::PlayerSettings wanted;
  std::stop_source stop;
  std::function<void()> interrupt;
  std::mutex opening_mutex;
  std::vector<stgs::player::PlayerEvent> opening_events;  // that are still to be told
  std::future<Opened> opening;                            // valid: until its end has been noted
  stgs::sdk::Outcome opened;                              // how the last opening ended
  bool has_ended = false;                                 // whether one has
  std::unique_ptr<stgs::player::Player> player;           // null: not open

  // Before the file is open: for then.
  bool playing = false, loop = false;
  double rate = 1;

  Events events;
  Event told;  // the last that was taken

  // Calls `open` on a thread of its own.
  void begin_opening(std::function<Opened()> open);
  // Takes note of the end of opening, where it has ended or is waited for.
  void note_opened(bool wait);
  void tell(Event event) noexcept;
  // Takes what the opening and the player tell.
  void take_events();

 private:
  void tell(stgs::player::PlayerEvent& from);
  void take_opening_events();
  // What was wrong with the file when it was opened.
  void tell_damage();
  stgs::sdk::Outcome take_opened();
};
