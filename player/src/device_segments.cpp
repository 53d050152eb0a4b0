// SPDX-License-Identifier: Apache-2.0
#include "device_segments.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "resident_segment.h"
#include "stgs/format/decoder_model.h"

namespace stgs::player {
namespace {

// Primitives that are decoded at once, about: their floats are held beside what is drawn from.
constexpr std::uint64_t kBatch = 1 << 19;
constexpr std::uint64_t kMostDrawn = 1 << 28;  // that a frame of any backend numbers
// Of a picture while somebody plays, for what may come later: at 100 a second the least leaves as
// much to draw it.
constexpr std::chrono::milliseconds kLeastSending{4}, kMostSending{250};

template <typename T>
bool same_owner(const std::weak_ptr<T>& a, const std::shared_ptr<T>& b) {
  return !a.owner_before(b) && !b.owner_before(a);
}

}  // namespace

Result<std::vector<Timeline::SegmentRef>> DeviceSegments::make_resident(Timeline& timeline,
                                                                        double seconds) {
  std::vector<Timeline::SegmentRef> needed;
  do {
    STGS_ASSIGN(needed, timeline.visible_segments(seconds));
    STGS_TRY(change_to(timeline));
    STGS_TRY(make_present(timeline, needed, seconds));
    // Some may have turned out to be lost. Others may have come meanwhile: they are for next time.
    STGS_ASSIGN(needed, timeline.visible_segments(seconds));
  } while (timeline_.lock() != timeline.identity());
  waiting_ = 0;
  std::erase_if(needed, [this](const Timeline::SegmentRef& one) {
    const auto found = held_.find(one.segment);
    const bool there = found != held_.end();
    if (one.set != nullptr && !(there && same_owner(found->second.set, one.set))) {
      waiting_ += one.set->size();
    }
    return !there;
  });
  return needed;
}

void DeviceSegments::insert(std::uint32_t segment, std::uint64_t primitives, std::uint64_t bytes) {
  if (const auto before = held_.find(segment); before != held_.end()) {
    bytes_ -= before->second.bytes;
    primitives_ -= before->second.primitives;
  }
  held_.insert_or_assign(segment, Held{bytes, primitives, {call_, As::kNeeded}, {}});
  bytes_ += bytes;
  primitives_ += primitives;
}

Status DeviceSegments::decode_on_cpu(Timeline& timeline, std::uint32_t segment) {
  STGS_ASSIGN(const std::optional<Gaussians4D> set, timeline.decode(segment));
  return set ? send_all(segment, *set) : Status();
}

Status DeviceSegments::send_all(std::uint32_t segment, const Gaussians4D& set) {
  arriving_[segment] = {};  // what is given up where this throws
  Status status;
  for (std::size_t first = 0; status.ok() && (first == 0 || first < set.size());
       first += kMaxUploadPrimitives) {
    status = upload(segment, set, first);
  }
  if (!status.ok()) cancel_upload(segment);
  arriving_.erase(segment);
  return status;
}

void DeviceSegments::clear() {
  abandon_others({});
  while (!held_.empty()) drop(held_.begin());
}

void DeviceSegments::drop(Segments::iterator segment) {
  bytes_ -= segment->second.bytes;
  primitives_ -= segment->second.primitives;
  release(segment->first);
  held_.erase(segment);
}

void DeviceSegments::make_room(const Timeline& timeline, std::uint64_t more, const Use& least) {
  while (bytes_ + more > timeline.memory_budget()) {
    const auto oldest = std::min_element(
        held_.begin(), held_.end(),
        [](const auto& a, const auto& b) { return a.second.used < b.second.used; });
    if (oldest == held_.end() || oldest->second.used >= least) return;
    drop(oldest);
  }
}

bool DeviceSegments::has(const Timeline::SegmentRef& asked, bool now) {
  const auto found = held_.find(asked.segment);
  if (found == held_.end()) return false;
  const bool same = same_owner(found->second.set, asked.set);
  found->second.used = {call_, !now ? As::kAhead : same ? As::kNeeded : As::kOutdated};
  return same;
}

void DeviceSegments::fit_ahead(const Timeline& timeline, std::uint64_t more,
                               std::vector<const Timeline::SegmentRef*>& ahead) {
  std::uint64_t stays = more;
  for (const auto& [segment, held] : held_) stays += held.used.call == call_ ? held.bytes : 0;
  std::size_t fitting = 0;
  for (; fitting < ahead.size(); ++fitting) {
    stays += bytes_of(timeline.reader().segments()[ahead[fitting]->segment].primitives);
    if (stays > timeline.memory_budget()) break;
    more += bytes_of(timeline.reader().segments()[ahead[fitting]->segment].primitives);
  }
  ahead.resize(fitting);
  make_room(timeline, more, {call_, As::kAhead});
}

void DeviceSegments::abandon_others(std::span<const Timeline::SegmentRef* const> these) {
  std::erase_if(arriving_, [&](const auto& one) {
    const bool wanted = std::any_of(these.begin(), these.end(), [&](const auto* needed) {
      return needed->segment == one.first && same_owner(one.second.set, needed->set);
    });
    if (!wanted) cancel_upload(one.first);
    return !wanted;
  });
}

Result<bool> DeviceSegments::send_piece(const Timeline::SegmentRef& needed) {
  Arriving& arriving = arriving_[needed.segment];
  arriving.set = needed.set;
  // It begins anew where this throws.
  const std::size_t first = std::exchange(arriving.sent, 0), sent = first + kMaxUploadPrimitives;
  const Status status = upload(needed.segment, *needed.set, first);
  const bool more = status.ok() && sent < needed.set->size();
  if (!status.ok()) cancel_upload(needed.segment);
  if (more) {
    arriving.sent = sent;
  } else {
    arriving_.erase(needed.segment);
  }
  STGS_TRY(status);
  if (!more) held_.at(needed.segment).set = needed.set;
  return more;
}

// A quarter of the time from picture to picture.
DeviceSegments::Clock::duration DeviceSegments::time_to_send(bool playing) {
  const Clock::time_point before = std::exchange(called_, now());
  if (!std::exchange(played_, playing)) return kLeastSending;
  return std::clamp<Clock::duration>((called_ - before) / 4, kLeastSending, kMostSending);
}

// Nothing waits of the first tier, without which there is no picture of a moment.
Status DeviceSegments::send_decoded(const Timeline& timeline,
                                    std::span<const Timeline::SegmentRef* const> decoded,
                                    std::span<const Timeline::SegmentRef* const> ahead) {
  const bool playing = timeline.is_playing();
  const Clock::duration time = time_to_send(playing);
  bool waits = false;  // whether there is no more time for what may wait
  for (const Timeline::SegmentRef* one : decoded) {
    const bool first = timeline.reader().segments()[one->segment].tier == 0;
    const bool may_wait = playing && (!first || held_.contains(one->segment));
    for (bool more = true; more && !(may_wait && waits);) {
      STGS_ASSIGN(more, send_piece(*one));
      if (may_wait) waits = now() >= called_ + time;
    }
  }
  for (const Timeline::SegmentRef* one : ahead) {
    bool more = true;
    while (more && now() < called_ + kLeastSending) {
      // The picture does without; where it cannot be sent when it is needed, that is told.
      const Result<bool> sent = send_piece(*one);
      if (!sent.ok()) return {};
      more = *sent;
    }
    if (more) break;
  }
  return {};
}

Status DeviceSegments::change_to(const Timeline& timeline) {
  const auto known = timeline_.lock();
  if (known != nullptr && known == timeline.identity()) {
    if (timeline.reader().segments().size() != known_) find_fullest(timeline);
    return {};
  }
  clear();
  timeline_.reset();
  sh_degree_ = timeline.reader().sh_degree();
  STGS_TRY(begin(timeline.reader()));
  no_room_ = false;
  find_fullest(timeline);
  if (fullest_.primitives > 0) reserve(bytes_of(fullest_.primitives));
  timeline_ = timeline.identity();
  return {};
}

void DeviceSegments::find_fullest(const Timeline& timeline) {
  known_ = timeline.reader().segments().size();
  if (no_room_) return;
  const DecoderNeeds needs = decoder_needs(timeline.reader());
  const std::uint64_t fitting =
      timeline.memory_budget() / (bytes_of(kMaxUploadPrimitives) / kMaxUploadPrimitives);
  fullest_ = {std::min({needs.primitives, fitting, kMostDrawn}),
              std::min(needs.segments, timeline.memory_budget() / bytes_of(1))};
}

Status DeviceSegments::make_present(Timeline& timeline,
                                    std::span<const Timeline::SegmentRef> needed, double seconds) {
  ++call_;
  const std::vector<Timeline::SegmentRef> soon = timeline.prefetch_segments(seconds);
  std::vector<const Timeline::SegmentRef*> ahead;
  for (const Timeline::SegmentRef& one : soon) {
    if (!has(one, false)) ahead.push_back(&one);
  }
  const auto& segments = timeline.reader().segments();
  std::vector<std::uint32_t> missing;
  std::vector<const Timeline::SegmentRef*> decoded;
  std::uint64_t together = 0, more = 0;
  for (const Timeline::SegmentRef& one : needed) {
    const SegmentInfo& info = segments[one.segment];
    const std::uint64_t bytes = info.available ? bytes_of(info.primitives) : 0;
    together += bytes;
    if (has(one, true)) continue;
    more += bytes;
    if (one.set == nullptr) {
      missing.push_back(one.segment);
    } else {
      decoded.push_back(&one);
    }
  }
  if (together > timeline.memory_budget()) {
    return over_budget(timeline.name(), seconds, together, timeline.memory_budget());
  }
  make_room(timeline, more, {call_, As::kNeeded});
  fit_ahead(timeline, more, ahead);
  std::stable_sort(decoded.begin(), decoded.end(), [&](const auto* a, const auto* b) {
    return segments[a->segment].tier < segments[b->segment].tier;
  });
  std::vector<const Timeline::SegmentRef*> wanted = decoded;
  wanted.insert(wanted.end(), ahead.begin(), ahead.end());
  abandon_others(wanted);
  STGS_TRY(send_decoded(timeline, decoded, ahead));
  return decode_all(timeline, missing);
}

Status DeviceSegments::decode_all(Timeline& timeline, std::span<const std::uint32_t> segments) {
  const std::vector<SegmentInfo>& infos = timeline.reader().segments();
  for (std::size_t first = 0, end = 0; first < segments.size(); first = end) {
    std::uint64_t primitives = 0;
    while (end < segments.size() && (end == first || primitives < kBatch)) {
      primitives += infos[segments[end++]].primitives;
    }
    STGS_TRY(decode(timeline, segments.subspan(first, end - first)));
  }
  return {};
}

}  // namespace stgs::player
