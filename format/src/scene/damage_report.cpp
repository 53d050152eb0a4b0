// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/damage_report.h"

#include <algorithm>

namespace stgs {
namespace {

constexpr std::size_t kMaxRanges = 4;  // listed per line

std::string seconds_text(const TickRange& range, const TimeBase& time_base) {
  return fmt::format("{:.3f} to {:.3f} s", time_base.seconds(range.begin),
                     time_base.seconds(range.end));
}

std::string seconds_text(const std::vector<TickRange>& ranges, const TimeBase& time_base) {
  std::string text;
  for (std::size_t i = 0; i < std::min(ranges.size(), kMaxRanges); ++i) {
    text += (i > 0 ? ", " : "at ") + seconds_text(ranges[i], time_base);
  }
  if (ranges.size() > kMaxRanges)
    text += fmt::format(" and {} more ranges", ranges.size() - kMaxRanges);
  return text.empty() ? "never" : text;
}

std::string fragment_text(const LostFragment& fragment, const TimeBase& time_base) {
  return fmt::format("content needed at {} is lost because the index is damaged ({} bytes)",
                     seconds_text(fragment.range, time_base), fragment.bytes);
}

std::string records_text(const DamageReport& report, const TimeBase& time_base) {
  std::string text;
  const auto add = [&text](const std::string& part) { text += (text.empty() ? "" : ", ") + part; };
  if (report.segments > 0) {
    add(fmt::format("{} of {} tiers of segments ({} primitives)", report.segments,
                    report.total_segments, report.primitives));
  }
  if (report.segments_without_sh > 0) {
    add(fmt::format("the SH of {} of {} tiers of segments", report.segments_without_sh,
                    report.total_segments));
  }
  if (report.further > 0) {
    add(fmt::format("{} further {}", report.further, report.further == 1 ? "record" : "records"));
  }
  return fmt::format("cannot read {}: {} bytes, needed {}; first error: {}", text, report.bytes,
                     seconds_text(report.ranges, time_base), report.reason.message());
}

}  // namespace

std::vector<std::string> describe_damage(const DamageReport& report, const TimeBase& time_base) {
  std::vector<std::string> lines;
  for (const Issue& issue : report.damage) {
    lines.push_back(
        fmt::format("{} (byte {}, issue {})", issue.message, issue.offset, issue.number));
  }
  for (const LostFragment& fragment : report.lost_fragments) {
    lines.push_back(fragment_text(fragment, time_base));
  }
  if (report.incomplete_bytes > 0) {
    lines.push_back(fmt::format("{} bytes after the last complete fragment are ignored",
                                report.incomplete_bytes));
  }
  if (!report.reason.ok()) lines.push_back(records_text(report, time_base));
  if (!report.importance.ok()) {
    lines.push_back(fmt::format("importances are ignored: {}", report.importance.message()));
  }
  return lines;
}

}  // namespace stgs
