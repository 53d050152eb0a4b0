// SPDX-License-Identifier: Apache-2.0
#include "damage.h"

#include "player_events.h"

namespace stgs::tools {
namespace {

DamageCount count_of(const player::Timeline& timeline) {
  DamageCount count;
  for (const player::SegmentDamage& damage : timeline.segment_damage()) {
    ++(damage.sh_only ? count.without_sh : count.skipped);
    if (count.first.empty()) count.first = damage.reason.message();
  }
  return count;
}

// Converts a kind of event that has a message.
stgs_event_kind kind_of(player::PlayerEvent::Kind kind) {
  using Kind = player::PlayerEvent::Kind;
  switch (kind) {
    case Kind::kRetry:
      return STGS_EVENT_RETRY;
    case Kind::kReadFailed:
      return STGS_EVENT_READ_FAILED;
    case Kind::kReplaced:
      return STGS_EVENT_REPLACED;
    case Kind::kStalled:
      return STGS_EVENT_STALLED;
    default:
      return STGS_EVENT_DAMAGED;
  }
}

}  // namespace

void warn_of_open_damage(Session& session, const player::Timeline& timeline) {
  for (const Issue& issue : timeline.damage()) {
    warn_of_issue(session, timeline.name(), issue.message, timeline.complete_seconds());
  }
}

void warn_of_damage(Session& session, const player::Timeline& timeline) {
  warn_of_damage(session, timeline.name(), count_of(timeline));
}

void warn_of_damage(Session& session, const std::string& file, const DamageReport& damage,
                    const TimeBase& time_base) {
  for (const std::string& line : describe_damage(damage, time_base)) {
    session.log(1, fmt::format("{}: {}", file, line));
  }
}

Json damage_json(const player::Timeline& timeline) {
  return damage_json(count_of(timeline));
}

Json damage_json(const DamageReport& damage) {
  return {{"segments", damage.segments}, {"sh", damage.segments_without_sh}};
}

void warn_of_event(Session& session, const player::PlayerEvent& event) {
  warn_of_event(session, kind_of(event.kind), event.offset, event.message);
}

}  // namespace stgs::tools
