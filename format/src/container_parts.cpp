// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "bytes.h"
#include "container.h"

namespace stgs {
namespace {

using N = IssueNumber;

constexpr std::uint64_t kPartBytes = 20;
constexpr std::uint64_t kWindowBytes = 24;

}  // namespace

bool parse_parts(std::span<const std::uint8_t> payload, std::uint64_t offset, std::uint32_t frames,
                 std::vector<PartEntry>& parts, Findings& findings) {  // spec 5.10
  ByteReader in(payload);
  const std::uint32_t count = in.u32();
  if (!in.ok() || count == 0 || in.left() / kPartBytes < count) {
    findings.error(N::kParts, offset, "parts: {} bytes are too few for {}, or there are none",
                   payload.size(), count);
    return false;
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint64_t at = offset + in.position();
    PartEntry part;
    part.begin = in.f64();
    part.end = in.f64();
    part.segments = in.u32();
    if (!(part.begin >= 0.0 && part.begin < part.end && part.end <= frames)) {
      findings.error(N::kParts, at, "parts: part {} lasts from {} to {} of {} frames", i,
                     part.begin, part.end, frames);
      return false;
    }
    parts.push_back(part);
  }
  return true;
}

bool parse_window(std::span<const std::uint8_t> payload, std::uint64_t offset,
                  SceneMetadata& metadata, Findings& findings) {  // spec 4.5
  if (payload.size() < kWindowBytes) {
    findings.error(N::kWindow, offset, "window: {} bytes are too few", payload.size());
    return false;
  }
  ByteReader in(payload);
  CaptureWindow window;
  window.first_frame = in.u32();
  window.capture_frames = in.u32();
  window.capture = in.u64();
  window.training = in.u64();
  metadata.window = window;
  return true;
}

void check_window(const SceneMetadata& metadata, Findings& findings) {
  if (!metadata.window) return;
  const CaptureWindow& window = *metadata.window;
  if (std::uint64_t{window.first_frame} + metadata.frames <= window.capture_frames) return;
  findings.error(N::kWindow, kHeaderBytes,
                 "window: {} frames from frame {} on do not lie in a capture of {} frames",
                 metadata.frames, window.first_frame, window.capture_frames);
}

bool PartCursor::begins_part(std::uint64_t segment) {
  while (next_ < parts_.size() && first_ < segment) first_ += parts_[next_++].segments;
  return next_ < parts_.size() && first_ == segment;
}

bool assign_parts(FileHead& head, std::uint64_t offset, Findings& findings) {
  std::vector<SegmentEntry>& segments = head.index.segments;
  if (head.parts.empty()) {
    head.parts.push_back({0.0, static_cast<double>(head.metadata.scene.frames),
                          static_cast<std::uint32_t>(segments.size())});
  }
  std::uint64_t next = 0;
  for (std::uint32_t p = 0; p < head.parts.size(); ++p) {
    const std::uint64_t end = next + head.parts[p].segments;
    for (; next < end && next < segments.size(); ++next) segments[next].part = p;
    next = end;
  }
  if (next != segments.size()) {
    findings.error(N::kParts, offset, "parts: they have {} segments, the index has {}", next,
                   segments.size());
    return false;
  }
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Interval interval = interval_of(head, segments[i]);
    if (interval.begin < interval.end) continue;
    findings.error(N::kSegmentInterval, offset, "index: segment {} lies outside its part", i);
    return false;
  }
  return true;
}

Interval interval_of(const FileHead& head, const SegmentEntry& segment) {
  const PartEntry& part = head.parts[segment.part];
  const Interval whole = interval_of(segment.base.level, segment.base.slot, head.index.chunk_ticks,
                                     head.metadata.scene.frames);
  return {std::max(whole.begin, part.begin), std::min(whole.end, part.end)};
}

}  // namespace stgs
