// SPDX-License-Identifier: Apache-2.0
#include "damage.h"

#include <algorithm>

namespace stgs::tools {
namespace {

std::ptrdiff_t without_sh(const player::Timeline& timeline) {
  return std::count_if(timeline.segment_damage().begin(), timeline.segment_damage().end(),
                       [](const player::SegmentDamage& damage) { return damage.sh_only; });
}

std::ptrdiff_t skipped(const player::Timeline& timeline) {
  return std::ssize(timeline.segment_damage()) - without_sh(timeline);
}

}  // namespace

void warn_of_open_damage(Session& session, const player::Timeline& timeline) {
  for (const Issue& issue : timeline.damage()) {
    session.log(1, fmt::format("{}: {}; it is complete up to {:.3f} s", timeline.name(),
                               issue.message, timeline.complete_seconds()));
  }
}

void warn_of_damage(Session& session, const player::Timeline& timeline) {
  if (timeline.segment_damage().empty()) return;
  std::string text;
  if (skipped(timeline) > 0) {
    text = fmt::format("skipped {}", plural(skipped(timeline), "damaged segment"));
  }
  if (without_sh(timeline) > 0) {
    text += fmt::format("{}rendered {} without SH", text.empty() ? "" : ", ",
                        plural(without_sh(timeline), "segment"));
  }
  session.log(1, fmt::format("{}: {}; first: {}", timeline.name(), text,
                             timeline.segment_damage().front().reason.message()));
}

void warn_of_damage(Session& session, const std::string& file, const DamageReport& damage,
                    const TimeBase& time_base) {
  for (const std::string& line : describe_damage(damage, time_base)) {
    session.log(1, fmt::format("{}: {}", file, line));
  }
}

Json damage_json(const player::Timeline& timeline) {
  return {{"segments", skipped(timeline)}, {"sh", without_sh(timeline)}};
}

Json damage_json(const DamageReport& damage) {
  return {{"segments", damage.segments}, {"sh", damage.segments_without_sh}};
}

const char* event_text(player::PlayerEvent::Kind kind) {
  using Kind = player::PlayerEvent::Kind;
  switch (kind) {
    case Kind::kRetry:
      return "retrying";
    case Kind::kReadFailed:
      return "missing for now";
    case Kind::kReplaced:
      return "file changed, no more of it can be read";
    case Kind::kStalled:
      return "waiting for the recorder";
    default:
      return "damaged, skipped";
  }
}

void warn_of_event(Session& session, const player::PlayerEvent& event) {
  session.log(
      1, fmt::format("at byte {}: {} ({})", event.offset, event.message, event_text(event.kind)));
}

}  // namespace stgs::tools
