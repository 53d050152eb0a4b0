// SPDX-License-Identifier: Apache-2.0
// The settings for URLs that scenes and players share.
#include <cmath>
#include <limits>
#include <string>

#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

stgs_result defaults(stgs_scene_settings* settings) {
  return stgs_scene_settings_defaults(settings, sizeof(*settings));
}
stgs_result defaults(stgs_player_settings* settings) {
  return stgs_player_settings_defaults(settings, sizeof(*settings));
}
stgs_result create(const stgs_scene_settings& settings) {
  stgs_scene* scene = nullptr;
  const stgs_result result = stgs_scene_create(&settings, &scene);
  stgs_scene_destroy(scene);
  return result;
}
stgs_result create(const stgs_player_settings& settings) {
  stgs_player* player = nullptr;
  const stgs_result result = stgs_player_create(&settings, &player);
  stgs_player_destroy(player);
  return result;
}

template <typename Settings>
void check_ranges() {
  std::string logged;
  Settings settings;
  REQUIRE(defaults(&settings) == STGS_OK);
  CHECK(settings.url_timeout_seconds == 60);
  CHECK(settings.url_min_bytes_per_second == 1000);
  CHECK(settings.url_allow_private == 0);
  settings.log_user = &logged;
  settings.log = [](void* user, stgs_log_level, const char* message) {
    *static_cast<std::string*>(user) = message;
  };
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (double Settings::*const member :
       {&Settings::url_timeout_seconds, &Settings::url_min_bytes_per_second}) {
    for (const double value : {0.0, -1.0, 1e10, kInfinity, std::nan("")}) {
      Settings wrong = settings;
      wrong.*member = value;
      CHECK(create(wrong) == STGS_ERROR_ARGUMENT);
    }
  }
  CHECK(logged == "settings: url_min_bytes_per_second is nan (expected 1 to 1000000000)");
  for (const double seconds : {0.1, 1e6}) {
    settings.url_timeout_seconds = seconds;
    settings.url_allow_private = 1;
    CHECK(create(settings) == STGS_OK);
  }
}

TEST_CASE("the limits of reads from URLs are finite and positive", "[sdk]") {
  check_ranges<stgs_scene_settings>();
  check_ranges<stgs_player_settings>();
}

}  // namespace
}  // namespace stgs::testing
