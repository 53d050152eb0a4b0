// SPDX-License-Identifier: Apache-2.0
// Messages about what happened to a player.
#pragma once

#include <cstdint>
#include <string>

#include "session.h"
#include "stgs/stgs.h"

namespace stgs::tools {

// Returns the consequence of an event that has a message, in a few words.
const char* event_text(stgs_event_kind kind);
// Warns of an event that has a message. `offset`: position in the file, bytes.
void warn_of_event(Session& session, stgs_event_kind kind, std::uint64_t offset,
                   const std::string& message);

}  // namespace stgs::tools
