// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "scene.h"
#include "stgs/player/player.h"
#include "tasks.h"

struct stgs_player {
  // event.message is set to `message` when the event is returned.
  struct Event {
    stgs_player_event event{};
    std::string message;
  };
  // A ring buffer of the last STGS_MAX_EVENTS events. Allocated up front, so that a lack of memory
  // can be reported.
  class Events {
   public:
    Events() : slots_(STGS_MAX_EVENTS) {}
    bool empty() const { return count_ == 0; }
    // Drops the oldest event if the buffer is full.
    void push(Event event) noexcept {
      slots_[(first_ + count_) % slots_.size()] = std::move(event);
      if (count_ < slots_.size()) {
        ++count_;
      } else {
        first_ = (first_ + 1) % slots_.size();
      }
    }
    // Removes the oldest event; the buffer must not be empty.
    Event pop() noexcept {
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
  std::unique_ptr<stgs::TaskRunner> tasks;  // null: threads of the library
  stgs::player::PlayerSettings open_settings;
  std::stop_source stop;            // aborts transfers of a URL
  std::function<void()> interrupt;  // aborts reads of the caller's source
  std::mutex opening_mutex;
  std::vector<stgs::player::PlayerEvent> opening_events;  // not yet queued; under opening_mutex
  std::future<Opened> opening;                            // valid until finish_opening()
  stgs::sdk::Outcome opened;                              // outcome of the last opening
  bool has_opened = false;                                // `opened` is set
  std::unique_ptr<stgs::player::Player> player;           // null: not open

  std::optional<double> last_now;  // of the last update

  // State to apply once the file is open.
  bool playing = false, loop = false;
  double rate = 1;

  Events events;
  Event last_event;  // returned last; owns its message

  // Runs `open` on a thread of its own.
  void begin_opening(std::function<Opened()> open);
  // Takes the result of opening if it has ended, or after waiting for it.
  void finish_opening(bool wait);
  void push_event(Event event) noexcept;
  // Queues the events of the opening and of the player.
  void collect_events();
  stgs::sdk::Outcome check_open() const;
  // Advances the player to `now` and queues its events.
  void advance(double now);
  stgs_player_status status() const;

 private:
  void push_event(stgs::player::PlayerEvent& from);
  void collect_opening_events();
  // Queues the errors found when the file was opened.
  void push_opening_damage();
  stgs::sdk::Outcome take_opened();
};
