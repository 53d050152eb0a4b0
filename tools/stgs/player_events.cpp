// SPDX-License-Identifier: Apache-2.0
#include "player_events.h"

namespace stgs::tools {

const char* event_text(stgs_event_kind kind) {
  switch (kind) {
    case STGS_EVENT_RETRY:
      return "retrying";
    case STGS_EVENT_READ_FAILED:
      return "missing for now";
    case STGS_EVENT_REPLACED:
      return "file changed, no more of it can be read";
    case STGS_EVENT_STALLED:
      return "waiting for the recorder";
    default:
      return "damaged, skipped";
  }
}

void warn_of_event(Session& session, stgs_event_kind kind, std::uint64_t offset,
                   const std::string& message) {
  session.log(1, fmt::format("at byte {}: {} ({})", offset, message, event_text(kind)));
}

}  // namespace stgs::tools
