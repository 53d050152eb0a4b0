// SPDX-License-Identifier: Apache-2.0
#include "device_segments.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "renderer_memory.h"
#include "resident_segment.h"
#include "stgs/format/decoder_model.h"

namespace stgs::player {
namespace {

// Approximate number of primitives per batch: their decoded floats need memory besides the packed
// segments.
constexpr std::uint64_t kBatch = 1 << 19;
constexpr std::uint64_t kMaxPrimitives = 1 << 28;  // per frame, on any backend
// Time per frame for deferrable uploads during playback. At 100 fps, the minimum leaves at least as
// much time for rendering.
constexpr std::chrono::milliseconds kMinUploadTime{4}, kMaxUploadTime{250};

template <typename T>
bool same_owner(const std::weak_ptr<T>& a, const std::shared_ptr<T>& b) {
  return !a.owner_before(b) && !b.owner_before(a);
}

}  // namespace

Result<std::vector<Timeline::SegmentRef>> DeviceSegments::make_resident(Timeline& timeline,
                                                                        double seconds) {
  std::vector<Timeline::SegmentRef> refs;
  do {
    STGS_ASSIGN(refs, timeline.visible_segments(seconds));
    STGS_TRY(switch_to(timeline));
    STGS_TRY(upload_missing(timeline, refs, seconds));
    // Some segments may have turned out to be unusable. Those that have arrived in the meantime are
    // left to the next call.
    STGS_ASSIGN(refs, timeline.visible_segments(seconds));
  } while (timeline_.lock() != timeline.identity());
  pending_ = 0;
  std::erase_if(refs, [this](const Timeline::SegmentRef& ref) {
    const auto found = resident_.find(ref.segment);
    const bool is_resident = found != resident_.end();
    if (ref.set != nullptr && !(is_resident && same_owner(found->second.set, ref.set))) {
      pending_ += ref.set->size();
    }
    return !is_resident;
  });
  for (Timeline::SegmentRef& ref : refs) ref.ticks -= resident_.at(ref.segment).time_origin;
  return refs;
}

void DeviceSegments::insert(std::uint32_t segment, std::uint64_t primitives, std::uint64_t bytes,
                            double time_origin) {
  if (const auto before = resident_.find(segment); before != resident_.end()) {
    bytes_ -= before->second.bytes;
    primitives_ -= before->second.primitives;
  }
  resident_.insert_or_assign(
      segment, Resident{bytes, primitives, time_origin, {call_, Priority::kActive}, {}, 0});
  bytes_ += bytes;
  primitives_ += primitives;
}

Result<Lease> DeviceSegments::charge_decoded(std::uint64_t primitives) const {
  constexpr auto kPool = Budget::Pool::kRenderer;
  const std::uint64_t bytes = decoded_segment_bytes(primitives, sh_degree_);
  std::optional<Lease> lease = budget_->try_charge(kPool, bytes);
  if (lease) return std::move(*lease);
  const Budget::Usage usage = budget_->usage(kPool);
  return renderer_limit_error(name_, "decoded segments", usage.used + bytes, usage.limit);
}

Status DeviceSegments::decode_on_cpu(Timeline& timeline, std::uint32_t segment) {
  STGS_ASSIGN(const Lease lease, charge_decoded(timeline.reader().segments()[segment].primitives));
  STGS_ASSIGN(const std::optional<Gaussians4D> set, timeline.decode(segment));
  return set ? upload_all(segment, *set) : Status();
}

Status DeviceSegments::upload_all(std::uint32_t segment, const Gaussians4D& set) {
  uploads_[segment] = {};  // so that the upload is cancelled if this throws
  Status status;
  for (std::size_t first = 0; status.ok() && (first == 0 || first < set.size());
       first += kMaxUploadPrimitives) {
    status = upload(segment, set, first);
  }
  if (!status.ok()) cancel_upload(segment);
  uploads_.erase(segment);
  return status;
}

void DeviceSegments::clear() {
  cancel_uploads_except({});
  while (!resident_.empty()) evict(resident_.begin());
}

void DeviceSegments::evict(Segments::iterator segment) {
  bytes_ -= segment->second.bytes;
  primitives_ -= segment->second.primitives;
  release(segment->first);
  resident_.erase(segment);
}

void DeviceSegments::evict_for(const Timeline& timeline, std::uint64_t bytes, const Use& limit) {
  while (bytes_ + bytes > timeline.memory_budget()) {
    const auto oldest = std::min_element(
        resident_.begin(), resident_.end(),
        [](const auto& a, const auto& b) { return a.second.used < b.second.used; });
    if (oldest == resident_.end() || !(oldest->second.used < limit)) return;
    evict(oldest);
  }
}

bool DeviceSegments::mark_used(const Timeline::SegmentRef& ref, bool is_active) {
  const auto found = resident_.find(ref.segment);
  if (found == resident_.end()) return false;
  const bool same = same_owner(found->second.set, ref.set) && found->second.version == ref.version;
  found->second.used = {call_, !is_active ? Priority::kPrefetched
                               : same     ? Priority::kActive
                                          : Priority::kOutdated};
  return same;
}

void DeviceSegments::fit_prefetch(const Timeline& timeline, std::uint64_t bytes,
                                  std::vector<const Timeline::SegmentRef*>& ahead) {
  const auto size_of = [&](const Timeline::SegmentRef* ref) {
    return bytes_of(timeline.reader().segments()[ref->segment].primitives);
  };
  std::uint64_t retained = bytes;
  for (const auto& [segment, one] : resident_) retained += one.used.call == call_ ? one.bytes : 0;
  std::size_t fitting = 0;
  for (; fitting < ahead.size(); ++fitting) {
    retained += size_of(ahead[fitting]);
    if (retained > timeline.memory_budget()) break;
    bytes += size_of(ahead[fitting]);
  }
  ahead.resize(fitting);
  evict_for(timeline, bytes, {call_, Priority::kPrefetched});
}

void DeviceSegments::cancel_uploads_except(std::span<const Timeline::SegmentRef* const> these) {
  std::erase_if(uploads_, [&](const auto& one) {
    const bool is_listed = std::any_of(these.begin(), these.end(), [&](const auto* ref) {
      return ref->segment == one.first && same_owner(one.second.set, ref->set);
    });
    if (!is_listed) cancel_upload(one.first);
    return !is_listed;
  });
}

Result<bool> DeviceSegments::upload_next(const Timeline::SegmentRef& ref) {
  UploadProgress& current = uploads_[ref.segment];
  current.set = ref.set;
  // If this throws, the upload restarts.
  const std::size_t first = std::exchange(current.done, 0), end = first + kMaxUploadPrimitives;
  const Status status = upload(ref.segment, *ref.set, first);
  const bool more = status.ok() && end < ref.set->size();
  if (!status.ok()) cancel_upload(ref.segment);
  if (more) {
    current.done = end;
  } else {
    uploads_.erase(ref.segment);
  }
  STGS_TRY(status);
  if (!more) resident_.at(ref.segment).set = ref.set;
  return more;
}

// A quarter of the time between frames.
DeviceSegments::Clock::duration DeviceSegments::upload_time(bool playing) {
  const Clock::time_point before = std::exchange(last_call_, now());
  if (!std::exchange(was_playing_, playing)) return kMinUploadTime;
  return std::clamp<Clock::duration>((last_call_ - before) / 4, kMinUploadTime, kMaxUploadTime);
}

// The first tier is never deferred: without it, a frame is incomplete.
Status DeviceSegments::upload_decoded(const Timeline& timeline,
                                      std::span<const Timeline::SegmentRef* const> decoded,
                                      std::span<const Timeline::SegmentRef* const> ahead) {
  const bool playing = timeline.is_playing();
  const Clock::duration time = upload_time(playing);
  bool out_of_time = false;  // for deferrable uploads
  for (const Timeline::SegmentRef* ref : decoded) {
    const bool is_first_tier = timeline.reader().segments()[ref->segment].tier == 0;
    const bool is_deferrable = playing && (!is_first_tier || resident_.contains(ref->segment));
    for (bool more = true; more && !(is_deferrable && out_of_time);) {
      STGS_ASSIGN(more, upload_next(*ref));
      if (is_deferrable) out_of_time = now() >= last_call_ + time;
    }
  }
  for (const Timeline::SegmentRef* ref : ahead) {
    bool more = true;
    while (more && now() < last_call_ + kMinUploadTime) {
      // The frame does not need it. If it still fails once it is needed, that is reported then.
      const Result<bool> uploaded = upload_next(*ref);
      if (!uploaded.ok()) return {};
      more = *uploaded;
    }
    if (more) break;
  }
  return {};
}

Status DeviceSegments::switch_to(const Timeline& timeline) {
  const auto current = timeline_.lock();
  if (current != nullptr && current == timeline.identity()) {
    if (timeline.reader().segments().size() != segment_count_) find_peak(timeline);
    return {};
  }
  clear();
  timeline_.reset();
  sh_degree_ = timeline.reader().sh_degree();
  name_ = timeline.name();
  memory_budget_ = timeline.memory_budget();
  charge_ = timeline.budget()->charge(Budget::Pool::kDeviceCopies, 0);
  budget_ = timeline.budget();
  STGS_TRY(begin(timeline.reader()));
  peak_does_not_fit_ = false;
  find_peak(timeline);
  if (peak_.primitives > 0) reserve(bytes_of(peak_.primitives));
  timeline_ = timeline.identity();
  return {};
}

void DeviceSegments::find_peak(const Timeline& timeline) {
  segment_count_ = timeline.reader().segments().size();
  if (peak_does_not_fit_) return;
  const DecoderNeeds needs = decoder_needs(timeline.reader());
  const std::uint64_t fitting =
      timeline.memory_budget() / (bytes_of(kMaxUploadPrimitives) / kMaxUploadPrimitives);
  peak_ = {std::min({needs.primitives, fitting, kMaxPrimitives}),
           std::min(needs.segments, timeline.memory_budget() / bytes_of(1))};
}

Status DeviceSegments::upload_missing(Timeline& timeline,
                                      std::span<const Timeline::SegmentRef> refs, double seconds) {
  ++call_;
  const std::vector<Timeline::SegmentRef> soon = timeline.prefetch_segments(seconds);
  std::vector<const Timeline::SegmentRef*> ahead;
  for (const Timeline::SegmentRef& ref : soon) {
    if (!mark_used(ref, false)) ahead.push_back(&ref);
  }
  const auto& segments = timeline.reader().segments();
  std::vector<std::uint32_t> missing;
  std::vector<const Timeline::SegmentRef*> decoded;
  std::uint64_t total = 0, more = 0;
  for (const Timeline::SegmentRef& ref : refs) {
    const SegmentInfo& info = segments[ref.segment];
    const std::uint64_t bytes = info.available ? bytes_of(info.primitives) : 0;
    total += bytes;
    if (mark_used(ref, true)) continue;
    more += bytes;
    if (ref.set == nullptr) {
      missing.push_back(ref.segment);
    } else {
      decoded.push_back(&ref);
    }
  }
  if (total > timeline.memory_budget()) {
    return over_budget_error(timeline.name(), seconds, total, timeline.memory_budget());
  }
  evict_for(timeline, more, {call_, Priority::kActive});
  fit_prefetch(timeline, more, ahead);
  for (const Timeline::SegmentRef* ref : ahead) more += bytes_of(segments[ref->segment].primitives);
  charge_.resize(bytes_ + more);
  std::stable_sort(decoded.begin(), decoded.end(), [&](const auto* a, const auto* b) {
    return segments[a->segment].tier < segments[b->segment].tier;
  });
  std::vector<const Timeline::SegmentRef*> current = decoded;
  current.insert(current.end(), ahead.begin(), ahead.end());
  cancel_uploads_except(current);
  STGS_TRY(upload_decoded(timeline, decoded, ahead));
  STGS_TRY(decode_batches(timeline, missing));
  for (const Timeline::SegmentRef& ref : refs) {
    if (const auto found = resident_.find(ref.segment); found != resident_.end())
      found->second.version = ref.version;
  }
  return {};
}

Status DeviceSegments::decode_batches(Timeline& timeline, std::span<const std::uint32_t> segments) {
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
