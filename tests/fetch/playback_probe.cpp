// SPDX-License-Identifier: Apache-2.0
// Opens and plays a file as `stgs play` does, without a window, until the base layer of the first
// time is resident. Reports errors and ends as `stgs play` does.
//
// usage: playback_probe LOCATION TIMEOUT
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "play/playback.h"

namespace stgs::tools {
namespace {

Status play(Session& session, const std::string& location) {
  PlaybackSettings settings;
  settings.file = location;
  STGS_ASSIGN(const auto playback, Playback::start(session, settings));
  for (;;) {
    const double now = now_seconds();
    STGS_ASSIGN(const bool is_open, playback->is_open(now));
    if (is_open) {
      STGS_TRY(playback->advance(now).status());
      if (playback->status().ready != 0) return {};
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

}  // namespace
}  // namespace stgs::tools

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: playback_probe LOCATION TIMEOUT\n");
    return 1;
  }
  stgs::tools::Session session;
  session.options.timeout = std::atof(argv[2]);
  return session.conclude(stgs::tools::play(session, argv[1]));
}
