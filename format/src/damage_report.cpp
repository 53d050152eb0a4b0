// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/damage_report.h"

#include <algorithm>

namespace stgs {
namespace {

constexpr std::size_t kMostRanges = 4;  // that a line names

std::string seconds_text(const TickRange& moments, const TimeBase& time_base) {
  return fmt::format("{:.3f} to {:.3f} s", time_base.seconds(moments.begin),
                     time_base.seconds(moments.end));
}

std::string seconds_text(const std::vector<TickRange>& moments, const TimeBase& time_base) {
  std::string text;
  for (std::size_t i = 0; i < std::min(moments.size(), kMostRanges); ++i) {
    text += (i > 0 ? ", " : "") + seconds_text(moments[i], time_base);
  }
  if (moments.size() > kMostRanges)
    text += fmt::format(" and {} more", moments.size() - kMostRanges);
  return text.empty() ? "never" : text;
}

std::string stretch_text(const LostFragment& stretch, const TimeBase& time_base) {
  const bool known = stretch.range.begin < stretch.range.end;
  return fmt::format("what is first seen {} is lost with a damaged fragment of the index: {} bytes",
                     known
                         ? "at " + seconds_text(stretch.range, time_base)
                         : fmt::format("from {:.3f} s on", time_base.seconds(stretch.range.begin)),
                     stretch.bytes);
}

std::string records_text(const DamageReport& losses, const TimeBase& time_base) {
  std::string text;
  const auto add = [&text](std::string part) { text += (text.empty() ? "" : ", ") + part; };
  if (losses.segments > 0) {
    add(fmt::format("{} of {} segments with {} primitives", losses.segments, losses.total_segments,
                    losses.primitives));
  }
  if (losses.segments_without_sh > 0) {
    add(fmt::format("the harmonics alone of {} of {} segments", losses.segments_without_sh,
                    losses.total_segments));
  }
  if (losses.further > 0) add(fmt::format("{} records of timed data", losses.further));
  return fmt::format("cannot be read: {}; {} bytes, of {}; the first: {}", text, losses.bytes,
                     seconds_text(losses.ranges, time_base), losses.reason.message());
}

}  // namespace

std::vector<std::string> describe_damage(const DamageReport& losses, const TimeBase& time_base) {
  std::vector<std::string> lines;
  for (const Issue& issue : losses.damage) {
    lines.push_back(
        fmt::format("{} (byte {}, issue {})", issue.message, issue.offset, issue.number));
  }
  for (const LostFragment& stretch : losses.lost_fragments) {
    lines.push_back(stretch_text(stretch, time_base));
  }
  if (losses.incomplete_bytes > 0) {
    const std::string why =
        losses.unreached_frames > 0
            ? fmt::format("up to {:.3f} s is recorded in them, but a damaged record hides it",
                          time_base.seconds(losses.unreached_frames))
            : "they were being written, or were cut off";
    lines.push_back(fmt::format("{} bytes after the last complete fragment are left out: {}",
                                losses.incomplete_bytes, why));
  }
  if (!losses.reason.ok()) lines.push_back(records_text(losses, time_base));
  if (!losses.importance.ok()) {
    lines.push_back(fmt::format("its importances are left out: {}", losses.importance.message()));
  }
  return lines;
}

}  // namespace stgs
