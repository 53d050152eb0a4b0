// SPDX-License-Identifier: Apache-2.0
#include "losses.h"

#include <algorithm>

namespace stgs::tools {
namespace {

std::ptrdiff_t without_harmonics(const player::Timeline& timeline) {
  return std::count_if(timeline.segment_damage().begin(), timeline.segment_damage().end(),
                       [](const player::SegmentDamage& loss) { return loss.sh_only; });
}

std::ptrdiff_t whole(const player::Timeline& timeline) {
  return std::ssize(timeline.segment_damage()) - without_harmonics(timeline);
}

}  // namespace

void tell_damage(Session& session, const player::Timeline& timeline) {
  for (const Issue& issue : timeline.damage()) {
    session.log(1, fmt::format("{}: {}; it is drawn as it is, whole up to {:.3f} s",
                               timeline.name(), issue.message, timeline.complete_seconds()));
  }
}

void tell_losses(Session& session, const player::Timeline& timeline) {
  if (timeline.segment_damage().empty()) return;
  session.log(1, fmt::format("{}: {} segment(s) could not be drawn, and {} only without their "
                             "harmonics; the first: {}",
                             timeline.name(), whole(timeline), without_harmonics(timeline),
                             timeline.segment_damage().front().reason.message()));
}

Json losses_json(const player::Timeline& timeline) {
  return {{"segments", whole(timeline)}, {"sh", without_harmonics(timeline)}};
}

const char* event_text(player::PlayerEvent::Kind kind) {
  using Kind = player::PlayerEvent::Kind;
  return kind == Kind::kRetry        ? "trying again"
         : kind == Kind::kReadFailed ? "missing for now"
         : kind == Kind::kReplaced   ? "nothing more of it comes"
         : kind == Kind::kStalled    ? "waiting for the recorder"
                                     : "damaged, left out";
}

void tell_event(Session& session, const player::PlayerEvent& event) {
  session.log(
      1, fmt::format("at byte {}: {} ({})", event.offset, event.message, event_text(event.kind)));
}

void tell_losses(Session& session, const std::string& file, const DamageReport& losses,
                 const TimeBase& time_base) {
  for (const std::string& line : describe_damage(losses, time_base)) {
    session.log(1, fmt::format("{}: {}", file, line));
  }
}

Json losses_json(const DamageReport& losses) {
  return {{"segments", losses.segments}, {"sh", losses.segments_without_sh}};
}

}  // namespace stgs::tools
