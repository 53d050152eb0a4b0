// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <set>
#include <string>

#include "memory.h"
#include "object.h"
#include "stgs/player/timeline.h"

struct stgs_scene {
  stgs::sdk::LastError error;
  stgs::sdk::Log log;
  stgs_scene_settings settings{};
  std::shared_ptr<std::pmr::memory_resource> memory;  // of what is held
  bool of_player = false;                             // then the timeline is the player's
  std::unique_ptr<stgs::player::Timeline> owned;      // null: not open, or the player's
  stgs::player::Timeline* timeline = nullptr;         // null: not open
  std::size_t losses_told = 0;
  std::shared_ptr<const void> losses_of;  // Timeline::identity() of these
  std::set<std::string> texts;            // that were given to the caller

  stgs::sdk::Outcome check_open() const {
    if (timeline != nullptr) return {};
    return {STGS_ERROR_STATE, of_player ? "the player's file is not open"
                                        : "no file is open: call one of the stgs_scene_open "
                                          "functions first"};
  }
  // The same text for as long as the scene: what a recording's reader says goes with the reader,
  // and the next stretch has another.
  const char* keep(const std::string& text) { return texts.insert(text).first->c_str(); }
  // Logs what was wrong with the file when it was opened.
  void tell_damage() const;
  // Logs what was passed over since the last call.
  void tell_losses();
  // STGS_ERROR_LIMIT where the segments of a moment do not fit into the memory. A player's always
  // do: it holds no others.
  stgs::sdk::Outcome check_memory(double seconds);
};
