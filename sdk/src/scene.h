// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <mutex>
#include <set>
#include <stop_token>
#include <string>
#include <vector>

#include "memory.h"
#include "object.h"
#include "stgs/player/timeline.h"

namespace stgs::sdk {

inline constexpr std::uint64_t kMinMemoryBudget = std::uint64_t{1} << 20;  // of a scene, bytes

}  // namespace stgs::sdk

struct stgs_scene {
  stgs::sdk::LastError error;
  stgs::sdk::Log log;
  stgs_scene_settings settings{};
  std::string name;       // of data without a location, in messages; empty: the source's own
  std::stop_source stop;  // aborts transfers of a URL
  std::shared_ptr<std::pmr::memory_resource> memory;  // of decoded data
  bool of_player = false;                             // the player owns the timeline
  std::unique_ptr<stgs::player::Timeline> owned;      // null: not open, or of a player
  stgs::player::Timeline* timeline = nullptr;         // null: not open
  std::size_t logged_damage = 0;                      // entries of segment_damage() already logged
  std::shared_ptr<const void> logged_for;             // Timeline::identity() that these belong to
  std::set<std::string> texts;                        // returned to the caller
  std::vector<stgs_histogram_bin> lifespans, speeds;  // of the last statistics

  stgs::sdk::Outcome check_open() const {
    if (timeline != nullptr) return {};
    return {STGS_ERROR_STATE,
            of_player ? "the file of the player is not open"
                      : "no file is open; call one of the stgs_scene_open functions first"};
  }
  // Returns a copy of the text that lives as long as the scene. The original may not: a recording
  // replaces its reader with each fragment.
  const char* intern(const std::string& text) { return texts.insert(text).first->c_str(); }
  // Logs the issues found when the file was opened.
  void log_issues() const;
  // Logs segments found damaged since the last call.
  void log_new_damage();
  // Turns the failure of a call that stgs_scene_cancel has ended into STGS_ERROR_CANCELLED.
  stgs::sdk::Outcome with_cancellation(stgs::sdk::Outcome outcome) const;
  // Checks that a time is in the clip, [0, duration], and moves times up to half a frame outside,
  // as rounding produces them, to its nearer end. A recording that a player follows has no end yet.
  stgs::sdk::Outcome clamp_time(double& seconds) const;
  // Returns STGS_ERROR_LIMIT if the segments of a time do not fit into memory_budget. Those of a
  // player always fit, because it retains no others.
  stgs::sdk::Outcome check_memory(double seconds);
};
