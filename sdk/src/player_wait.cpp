// SPDX-License-Identifier: Apache-2.0
// Blocks until a time of a player is complete.
#include <chrono>
#include <cmath>
#include <thread>

#include "player.h"
#include "structs.h"

using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kPollInterval{2};

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// Advances the player until its time is complete. Its clock continues from the last update, so that
// an application whose clock runs in real time sees no step.
Outcome wait_complete(stgs_player& player, double timeout_seconds) {
  const Clock::time_point begin = Clock::now();
  const double start =
      player.last_now.value_or(std::chrono::duration<double>(begin.time_since_epoch()).count());
  for (;;) {
    const double waited = seconds_since(begin);
    player.advance(start + waited);
    if (player.player->is_complete()) return {};
    if (waited >= timeout_seconds) {
      return {
          STGS_ERROR_TIMEOUT,
          fmt::format("{}: the time {:.6g} s was not complete within {:.6g} s",
                      player.scene.timeline->name(), player.player->seconds(), timeout_seconds)};
    }
    std::this_thread::sleep_for(kPollInterval);
  }
}

}  // namespace

extern "C" stgs_result stgs_player_seek_and_wait(stgs_player* player, double seconds,
                                                 double timeout_seconds,
                                                 stgs_player_status* status) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(player->check_open());
    if (!(timeout_seconds >= 0)) {
      return {STGS_ERROR_ARGUMENT,
              fmt::format("timeout_seconds is {} (expected at least 0)", timeout_seconds)};
    }
    if (status != nullptr) STGS_SDK_TRY(stgs::sdk::check_struct(status, "status"));
    STGS_SDK_TRY(player->player->seek(seconds));
    player->playing = false;
    player->player->pause();
    Outcome outcome = wait_complete(*player, timeout_seconds);
    if (status != nullptr) stgs::sdk::copy_out(status, player->status());
    return outcome;
  });
}
