// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/damage_report.h"

#include <algorithm>
#include <span>

namespace stgs {
namespace {

constexpr std::size_t kMaxRanges = 4;  // listed per line
constexpr std::size_t kMaxLines = 20;  // of a list: a damaged file of 14 MB has 200,000 entries

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

std::string further_fragments_text(const std::vector<LostFragment>& fragments) {
  std::uint64_t bytes = 0;
  for (const LostFragment& fragment : std::span(fragments).subspan(kMaxLines)) {
    bytes += fragment.bytes;
  }
  return fmt::format("{} further parts of the content are lost ({} bytes)",
                     fragments.size() - kMaxLines, bytes);
}

// Returns the entries of a list that have a line each.
template <typename T>
std::span<const T> listed(const std::vector<T>& list) {
  return std::span(list).first(std::min(list.size(), kMaxLines));
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
  for (const Issue& issue : listed(report.damage)) {
    lines.push_back(
        fmt::format("{} (byte {}, issue {})", issue.message, issue.offset, issue.number));
  }
  if (report.damage.size() > kMaxLines) {
    lines.push_back(fmt::format("{} further issues; 'stgs validate' lists them",
                                report.damage.size() - kMaxLines));
  }
  for (const LostFragment& fragment : listed(report.lost_fragments)) {
    lines.push_back(fragment_text(fragment, time_base));
  }
  if (report.lost_fragments.size() > kMaxLines) {
    lines.push_back(further_fragments_text(report.lost_fragments));
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
