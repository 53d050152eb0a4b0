// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <stop_token>
#include <string>

#include "scene.h"
#include "stgs/player/player.h"
#include "tasks.h"

struct stgs_player {
  // Its message is what stgs_player_event points to.
  struct Event {
    stgs_player_event event{};
    std::string message;
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
  std::future<Opened> opening;                   // valid: until its end has been noted
  stgs::sdk::Outcome opened;                     // how the last opening ended
  bool has_ended = false;                        // whether one has
  std::unique_ptr<stgs::player::Player> player;  // null: not open

  // Before the file is open: for then.
  bool playing = false, loop = false;
  double rate = 1;

  std::deque<Event> events;
  Event told;  // the last that was taken

  // Calls `open` on a thread of its own.
  void begin_opening(std::function<Opened()> open);
  // Takes note of the end of opening, where it has ended or is waited for.
  void note_opened(bool wait);
  void tell(Event event);
  // Takes what the player tells.
  void take_events();

 private:
  stgs::sdk::Outcome take_opened();
};
