// SPDX-License-Identifier: Apache-2.0
// Reports damage of files that can still be rendered or read in part.
#pragma once

#include "damage_count.h"
#include "session.h"
#include "stgs/format/damage_report.h"
#include "stgs/player/player.h"
#include "stgs/player/timeline.h"

namespace stgs::tools {

// Warns of the damage found when the file was opened.
void warn_of_open_damage(Session& session, const player::Timeline& timeline);
// Warns of the segments that rendering has skipped, or rendered without SH.
void warn_of_damage(Session& session, const player::Timeline& timeline);
// Warns of everything that could not be read from a file.
void warn_of_damage(Session& session, const std::string& file, const DamageReport& damage,
                    const TimeBase& time_base);

// Returns the number of damaged tiers of segments as {"segments", "sh"}: skipped, and without SH
// only.
Json damage_json(const player::Timeline& timeline);
Json damage_json(const DamageReport& damage);

// Warns of a player event that has a message.
void warn_of_event(Session& session, const player::PlayerEvent& event);

}  // namespace stgs::tools
