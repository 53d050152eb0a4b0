// SPDX-License-Identifier: Apache-2.0
#include "stream/residency.h"

#include <algorithm>
#include <new>
#include <utility>

#include "stream/no_memory.h"

namespace stgs::player {
namespace {

constexpr Budget::Pool kPool = Budget::Pool::kSegments;

}  // namespace

void Residency::reserve(std::size_t segments) {
  reserve_for(entries_, segments);
  reserve_for(decodable_, segments);
  changes_.reserve(2 * segments);
  decode_changes_.reserve(segments);
}

void Residency::extend() noexcept {
  const std::vector<SegmentInfo>& segments = index_.reader().segments();
  const std::size_t first = entries_.size();
  entries_.resize(segments.size());
  for (std::size_t s = first; s < segments.size(); ++s) {
    const auto mark_unavailable = [](LayerState& layer) {
      layer.state = LoadState::kFailed;
      layer.retry_at = kNever;
    };
    if (!segments[s].available) mark_unavailable(entries_[s].base);
    if (!segments[s].sh_available) mark_unavailable(entries_[s].sh);
    if (segments[s].sh_bytes == 0) entries_[s].sh.state = LoadState::kResident;
  }
}

// Requests in flight are discarded when they end.
void Residency::clear() noexcept {
  for (const SegmentLayer& layer : index_.file_order()) {
    if (state(layer) == LoadState::kResident) erase_encoded_(index_.file_offset(layer));
  }
  entries_.clear();
  decodable_.clear();
  decoding_ = 0;
  damage_.clear();
  stored_primitives_ = 0;
  full_from_ = kNever;
}

bool Residency::begin_fetch(const SegmentLayer& layer, double deadline) {
  const std::uint64_t bytes = index_.memory_bytes(layer);
  if (!evict_for(bytes, deadline)) return false;
  if (deadline >= full_from_) full_from_ = kNever;
  LayerState& own = state_of(layer);
  own.charge = budget_.charge(kPool, bytes);
  set_state(layer, LoadState::kInFlight);
  return true;
}

void Residency::fetched(const SegmentLayer& layer) noexcept {
  set_state(layer, LoadState::kResident);
  update_decodable(layer.segment);
}

void Residency::begin_decode(std::uint32_t segment) noexcept {
  entries_[segment].decoding = true;
  entries_[segment].decoding_has_ends = true;
  ++decoding_;
  update_decodable(segment);
}

void Residency::end_decode(std::uint32_t segment) noexcept {
  entries_[segment].decoding = false;
  --decoding_;
  update_decodable(segment);
}

void Residency::failed(const SegmentLayer& layer, bool permanently, double now) noexcept {
  constexpr double kMaxBackoff = 10;  // seconds
  release(layer, LoadState::kFailed);
  LayerState& own = state_of(layer);
  own.backoff = own.backoff > 0 ? std::min(2 * own.backoff, std::max(kMaxBackoff, retry_seconds_))
                                : std::max(retry_seconds_, 1e-3);
  own.retry_at = permanently ? kNever : now + own.backoff;
  if (!layer.sh && permanently) evict_sh(layer.segment);  // useless without its base
}

void Residency::decoded(std::uint32_t segment, DecodedSegment resident, bool has_sh) noexcept {
  Entry& entry = entries_[segment];
  set_resident(segment, std::move(resident));
  entry.base.backoff = 0;
  entry.has_sh = has_sh;
  entry.is_outdated = entry.is_outdated && !entry.decoding_has_ends;
  update_decodable(segment);
  if (!has_sh || index_.reader().may_end()) return;
  // The segment is completely decoded: its encoded bytes are no longer needed.
  for (const bool sh : {false, true}) {
    const LocatedLayer layer = index_.locate({segment, sh});
    if (layer.bytes == 0) continue;
    erase_encoded_(layer.offset);
    Lease& charge = state_of(layer.layer).charge;
    charge.resize(charge.bytes() - layer.bytes);
  }
  entry.sh.backoff = 0;
}

void Residency::add_ends(const std::vector<std::uint32_t>& segments) noexcept {
  for (const std::uint32_t segment : segments) {
    entries_[segment].is_outdated = true;
    entries_[segment].decoding_has_ends = false;
    update_decodable(segment);
  }
}

bool Residency::record_damage(const SegmentLayer& layer, const Status& status) noexcept {
  try {
    damage_.push_back({layer.segment, layer.sh, status});
    return true;
  } catch (const std::bad_alloc&) {
    return false;
  }
}

bool Residency::is_decodable(std::uint32_t segment) const {
  const Entry& entry = entries_[segment];
  if (entry.decoding || entry.base.state != LoadState::kResident || !index_.is_needed(segment))
    return false;
  return entry.resident == nullptr || entry.is_outdated ||
         (!entry.has_sh && entry.sh.state == LoadState::kResident);
}

// Adds a segment whose state has changed to decodable_, or removes it.
void Residency::update_decodable(std::uint32_t segment) noexcept {
  std::size_t& slot = entries_[segment].slot;
  const bool is_listed = slot != kNoSlot;
  decode_changes_.add(segment);
  if (is_listed == is_decodable(segment)) return;
  if (is_listed) {
    const std::uint32_t last = decodable_.back();
    decodable_[slot] = last;
    entries_[last].slot = slot;
    decodable_.pop_back();
    slot = kNoSlot;
  } else {
    slot = decodable_.size();
    decodable_.push_back(segment);
  }
}

bool Residency::is_base_final(std::uint32_t segment) const {
  // Playback does not wait for a base that failed before, even while it is retried.
  const Entry& entry = entries_[segment];
  return entry.resident != nullptr || entry.base.state == LoadState::kFailed ||
         entry.base.backoff > 0 || !index_.is_needed(segment);
}

bool Residency::is_sh_final(std::uint32_t segment) const {
  const Entry& entry = entries_[segment];
  return entry.has_sh || entry.sh.state == LoadState::kFailed || entry.sh.backoff > 0 ||
         (entry.resident == nullptr && is_base_final(segment)) || !index_.is_needed(segment);
}

bool Residency::does_not_fit(const SegmentLayer& layer) const {
  return state(layer) == LoadState::kMissing && deadlines_.deadline(layer) >= full_from_;
}

bool Residency::ready(double ticks) const {
  if (!index_.reader().is_loaded(ticks, ticks)) return false;
  const std::vector<std::uint32_t> active = index_.reader().segments_between(ticks, ticks);
  return std::all_of(active.begin(), active.end(), [this](std::uint32_t one) {
    return index_.info(one).tier > 0 || is_base_final(one);
  });
}

std::vector<TickRange> Residency::ready_ranges() const {
  std::vector<TickRange> gaps;
  for (std::uint32_t s = 0; s < entries_.size(); ++s) {
    const SegmentInfo& info = index_.reader().segments()[s];
    if (info.tier == 0 && !is_base_final(s)) gaps.push_back({info.begin_ticks, info.end_ticks});
  }
  for (const TickRange& range : index_.reader().unloaded()) gaps.push_back(range);
  std::sort(gaps.begin(), gaps.end(),
            [](const TickRange& a, const TickRange& b) { return a.begin < b.begin; });
  const double end = index_.duration();
  std::vector<TickRange> ranges;
  double at = 0;
  for (const TickRange& gap : gaps) {
    if (gap.begin > at) ranges.push_back({at, std::min(gap.begin, end)});
    at = std::max(at, gap.end);
  }
  if (at < end) ranges.push_back({at, end});
  return ranges;
}

int Residency::layers(double ticks) const {
  if (!index_.reader().is_loaded(ticks, ticks)) return 0;
  const std::vector<std::uint32_t> active = index_.reader().segments_between(ticks, ticks);
  int layers = 2 * index_.tiers();
  for (const std::uint32_t s : active) {
    const Entry& entry = entries_[s];
    if (entry.resident == nullptr) {
      layers = std::min(layers, index_.layer_number({s, false}));
    } else if (!entry.has_sh) {
      layers = std::min(layers, index_.layer_number({s, true}));
    }
  }
  return layers;
}

bool Residency::is_complete(double ticks) const {
  if (!index_.reader().is_loaded(ticks, ticks)) return false;
  const std::vector<std::uint32_t> active = index_.reader().segments_between(ticks, ticks);
  return std::all_of(active.begin(), active.end(), [this](std::uint32_t s) {
    if (!is_base_final(s)) return does_not_fit({s, false});
    if (entries_[s].is_outdated && entries_[s].base.state == LoadState::kResident) return false;
    return is_sh_final(s) || does_not_fit({s, true});
  });
}

void Residency::set_resident(std::uint32_t segment, DecodedSegment resident) noexcept {
  DecodedSegment& own = entries_[segment].resident;
  if (own != nullptr) stored_primitives_ -= own->set.size();
  own = std::move(resident);
  if (own != nullptr) stored_primitives_ += own->set.size();
}

void Residency::set_state(const SegmentLayer& layer, LoadState state) noexcept {
  state_of(layer).state = state;
  changes_.add(layer);
}

// Releases the bytes and memory of a layer that is no longer resident or in flight.
void Residency::release(const SegmentLayer& layer, LoadState state) noexcept {
  erase_encoded_(index_.file_offset(layer));
  state_of(layer).charge.resize(0);
  set_state(layer, state);
  update_decodable(layer.segment);
}

// Returns whether a segment holds memory and is neither being decoded nor fetched.
bool Residency::is_evictable(std::uint32_t segment) const {
  const Entry& entry = entries_[segment];
  return entry.base.charge.bytes() + entry.sh.charge.bytes() > 0 && !entry.decoding &&
         entry.base.state != LoadState::kInFlight && entry.sh.state != LoadState::kInFlight;
}

// Evicts segments with a later deadline, latest first, until `bytes` more fit the budget. Returns
// false and evicts nothing if that is impossible.
bool Residency::evict_for(std::uint64_t bytes, double deadline) {
  if (budget_.fits(kPool, bytes)) return true;
  std::vector<std::pair<double, std::uint32_t>> later;
  std::uint64_t available = budget_.available(kPool);
  for (std::uint32_t s = 0; s < entries_.size(); ++s) {
    if (!is_evictable(s)) continue;
    const double own = deadlines_.deadline({s, false});
    if (own <= deadline) continue;
    later.emplace_back(own, s);
    available += entries_[s].base.charge.bytes() + entries_[s].sh.charge.bytes();
  }
  if (available < bytes) return false;
  std::sort(later.rbegin(), later.rend());
  for (std::size_t k = 0; !budget_.fits(kPool, bytes); ++k) evict(later[k].second);
  return true;
}

void Residency::evict(std::uint32_t segment) noexcept {
  for (const bool sh : {false, true}) {
    const SegmentLayer layer{segment, sh};
    if (index_.stored_bytes(layer) > 0 && state(layer) == LoadState::kResident)
      release(layer, LoadState::kMissing);
  }
  set_resident(segment, nullptr);
  entries_[segment].has_sh = false;
  update_decodable(segment);
}

void Residency::apply_needs() noexcept {
  for (std::uint32_t s = 0; s < entries_.size(); ++s) {
    if (index_.is_needed(s)) {
      update_decodable(s);
    } else if (is_evictable(s)) {
      evict(s);
    } else {
      set_resident(s, nullptr);
      update_decodable(s);
    }
  }
}

void Residency::evict_sh(std::uint32_t segment) noexcept {
  const SegmentLayer layer{segment, true};
  if (index_.stored_bytes(layer) > 0 && state(layer) == LoadState::kResident)
    release(layer, LoadState::kMissing);
}

}  // namespace stgs::player
