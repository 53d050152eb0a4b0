// SPDX-License-Identifier: Apache-2.0
#include "device_segments.h"

#include <algorithm>
#include <optional>

#include "stgs/format/decoder_model.h"

namespace stgs::player {
namespace {

constexpr double kMiB = 1 << 20;
// Primitives that are decoded at once, about: their floats are held beside what is drawn from.
constexpr std::uint64_t kBatch = 1 << 19;
constexpr std::uint64_t kMostDrawn = 1 << 28;  // that a frame of any backend numbers
// Of a picture while somebody plays, for what may come later: at 100 a second there is as much left
// to draw it.
constexpr std::chrono::milliseconds kMostSending{4};

template <typename T>
bool same_owner(const std::weak_ptr<T>& a, const std::shared_ptr<T>& b) {
  return !a.owner_before(b) && !b.owner_before(a);
}

}  // namespace

Result<std::vector<Timeline::Needed>> DeviceSegments::hold(Timeline& timeline, double seconds) {
  STGS_ASSIGN(std::vector<Timeline::Needed> needed, timeline.needed_at(seconds));
  STGS_TRY(change_to(timeline));
  STGS_TRY(make_present(timeline, needed, seconds));
  // Some may have turned out to be lost. Others may have come meanwhile: they are for next time.
  STGS_ASSIGN(needed, timeline.needed_at(seconds));
  std::erase_if(needed,
                [this](const Timeline::Needed& one) { return !held_.contains(one.segment); });
  return needed;
}

void DeviceSegments::keep(std::uint32_t segment, std::uint64_t primitives, std::uint64_t bytes) {
  if (const auto before = held_.find(segment); before != held_.end()) {
    bytes_ -= before->second.bytes;
    primitives_ -= before->second.primitives;
  }
  held_.insert_or_assign(segment, Held{bytes, primitives, call_, {}});
  bytes_ += bytes;
  primitives_ += primitives;
}

Status DeviceSegments::decode_here(Timeline& timeline, std::uint32_t segment) {
  STGS_ASSIGN(const std::optional<Gaussians4D> set, timeline.decode(segment));
  return set ? send_all(segment, *set) : Status();
}

Status DeviceSegments::send_all(std::uint32_t segment, const Gaussians4D& set) {
  for (std::size_t first = 0; first == 0 || first < set.size(); first += kPiece) {
    const Status status = send(segment, set, first);
    if (!status.ok()) abandon(segment);
    STGS_TRY(status);
  }
  return {};
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

bool DeviceSegments::has(const Timeline::Needed& needed) {
  const auto found = held_.find(needed.segment);
  if (found == held_.end()) return false;
  const bool same = same_owner(found->second.set, needed.set);
  found->second.used = same ? call_ : 0;
  return same;
}

void DeviceSegments::abandon_others(std::span<const Timeline::Needed> needed) {
  std::erase_if(arriving_, [&](const auto& one) {
    const auto found = std::lower_bound(
        needed.begin(), needed.end(), one.first,
        [](const Timeline::Needed& a, std::uint32_t segment) { return a.segment < segment; });
    const bool wanted = found != needed.end() && found->segment == one.first &&
                        same_owner(one.second.set, found->set);
    if (!wanted) abandon(one.first);
    return !wanted;
  });
}

Result<bool> DeviceSegments::send_piece(const Timeline::Needed& needed) {
  // Nothing arrives where sending it fails or throws: then it begins anew.
  const auto before = arriving_.extract(needed.segment);
  const std::size_t first = before.empty() ? 0 : before.mapped().sent;
  const Status status = send(needed.segment, *needed.set, first);
  if (!status.ok()) abandon(needed.segment);
  STGS_TRY(status);
  const std::size_t sent = first + kPiece;
  const bool more = sent < needed.set->size();
  if (more) {
    arriving_.emplace(needed.segment, Arriving{needed.set, sent});
  } else {
    held_.at(needed.segment).set = needed.set;
  }
  return more;
}

// Nothing waits of the first tier, without which there is no picture of a moment.
Status DeviceSegments::send_decoded(const Timeline& timeline,
                                    std::span<const Timeline::Needed* const> decoded) {
  const bool playing = timeline.is_playing();
  const Clock::time_point end = Clock::now() + kMostSending;
  bool enough = false;
  for (const Timeline::Needed* one : decoded) {
    const bool may_wait = playing && (timeline.reader().segments()[one->segment].tier > 0 ||
                                      held_.contains(one->segment));
    for (bool more = true; more && !(may_wait && enough);) {
      STGS_ASSIGN(more, send_piece(*one));
      if (may_wait) enough = Clock::now() >= end;
    }
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
  find_fullest(timeline);
  if (fullest_.primitives > 0) reserve(bytes_of(fullest_.primitives));
  timeline_ = timeline.identity();
  return {};
}

void DeviceSegments::find_fullest(const Timeline& timeline) {
  const DecoderNeeds needs = decoder_needs(timeline.reader());
  const std::uint64_t fitting = timeline.memory_budget() / (bytes_of(kPiece) / kPiece);
  fullest_ = {std::min({needs.primitives, fitting, kMostDrawn}), needs.segments};
  known_ = timeline.reader().segments().size();
}

Status DeviceSegments::make_present(Timeline& timeline, std::span<const Timeline::Needed> needed,
                                    double seconds) {
  ++call_;
  abandon_others(needed);
  const auto& segments = timeline.reader().segments();
  std::vector<std::uint32_t> missing;
  std::vector<const Timeline::Needed*> decoded;
  std::uint64_t together = 0, more = 0;
  for (const Timeline::Needed& one : needed) {
    const SegmentInfo& info = segments[one.segment];
    const std::uint64_t bytes = info.there ? bytes_of(info.primitives) : 0;
    together += bytes;
    if (has(one)) continue;
    more += bytes;
    if (one.set == nullptr) {
      missing.push_back(one.segment);
    } else {
      decoded.push_back(&one);
    }
  }
  if (together > timeline.memory_budget()) {
    return runtime_error(
        "{}: the segments alive at {} s take {:.1f} MiB decoded, more than the budget of "
        "{:.1f} MiB; allow more memory",
        timeline.name(), seconds, static_cast<double>(together) / kMiB,
        static_cast<double>(timeline.memory_budget()) / kMiB);
  }
  while (!held_.empty() && bytes_ + more > timeline.memory_budget()) {
    drop(std::min_element(held_.begin(), held_.end(), [](const auto& a, const auto& b) {
      return a.second.used < b.second.used;
    }));
  }
  std::stable_sort(decoded.begin(), decoded.end(), [&](const auto* a, const auto* b) {
    return segments[a->segment].tier < segments[b->segment].tier;
  });
  STGS_TRY(send_decoded(timeline, decoded));
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
