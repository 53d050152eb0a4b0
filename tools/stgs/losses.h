// SPDX-License-Identifier: Apache-2.0
// What is wrong with a file that is drawn, or read, all the same.
#pragma once

#include "session.h"
#include "stgs/format/damage_report.h"
#include "stgs/player/player.h"
#include "stgs/player/timeline.h"

namespace stgs::tools {

// Warns of what was found when the file was opened.
void tell_damage(Session& session, const player::Timeline& timeline);
// Warns of the segments that were passed over while drawing, or drawn without their harmonics.
void tell_losses(Session& session, const player::Timeline& timeline);
// How many of each: {"segments", "sh"}.
Json losses_json(const player::Timeline& timeline);

// What an event that has a message tells, in a few words.
const char* event_text(player::PlayerEvent::Kind kind);
// Warns of such an event.
void tell_event(Session& session, const player::PlayerEvent& event);

// Warns of what could not be read of a whole file.
void tell_losses(Session& session, const std::string& file, const DamageReport& losses,
                 const TimeBase& time_base);
Json losses_json(const DamageReport& losses);

}  // namespace stgs::tools
