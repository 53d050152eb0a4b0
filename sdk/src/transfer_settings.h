// SPDX-License-Identifier: Apache-2.0
// The settings for URLs that scenes and players share.
#pragma once

#include "stgs/player/source.h"

namespace stgs::sdk {

// Sets the shared members of stgs_scene_settings or stgs_player_settings.
template <typename Settings>
void fill_transfer_settings(const player::HttpSettings& from, Settings& to) {
  to.url_timeout_seconds = from.request_seconds;
  to.url_min_bytes_per_second = from.min_bytes_per_second;
  to.url_allow_private = from.allow_private ? 1 : 0;
}

// Reads them. Their ranges have been checked.
template <typename Settings>
void read_transfer_settings(const Settings& from, player::HttpSettings& to) {
  to.request_seconds = from.url_timeout_seconds;
  to.min_bytes_per_second = from.url_min_bytes_per_second;
  to.allow_private = from.url_allow_private != 0;
}

}  // namespace stgs::sdk
