// SPDX-License-Identifier: Apache-2.0
#include "stream/fetch_plan.h"

#include <algorithm>
#include <functional>

namespace stgs::player {

bool FetchPlan::is_fetchable(const SegmentLayer& layer, double now) const {
  if (!index_.is_needed(layer.segment)) return false;
  const LoadState state = residency_.state(layer);
  if (state != LoadState::kMissing &&
      !(state == LoadState::kFailed && now >= residency_.retry_at(layer)))
    return false;
  const LoadState base = residency_.state({layer.segment, false});
  if (layer.sh && base != LoadState::kResident && base != LoadState::kInFlight) return false;
  return deadlines_.need(layer.segment).from <= prefetch_seconds_;
}

double FetchPlan::min_speed(const SegmentLayer& layer) const {
  if (index_.layer_number(layer) == 0) return 0;
  return static_cast<double>(index_.stored_bytes(layer)) / deadlines_.need(layer.segment).until;
}

// Returns whether only states of layers have changed since rebuild().
bool FetchPlan::is_current() const {
  return is_built_ && revision_ == index_.revision() && playhead_ == deadlines_.playhead() &&
         residency_.changes().since(changes_until_).has_value();
}

void FetchPlan::update(double now) {
  if (!is_current()) return rebuild(now);
  is_built_ = false;  // if this throws
  const std::span<const SegmentLayer> changed = *residency_.changes().since(changes_until_);
  for (const SegmentLayer& layer : changed) {
    // The spherical harmonics of a segment wait for its base.
    for (const bool sh : {false, true}) {
      if (sh < layer.sh || index_.stored_bytes({layer.segment, sh}) == 0) continue;
      const std::uint32_t slot = slot_of_[index_.file_index({layer.segment, sh})];
      if (slot != kNoSlot) examine(slot, now);
    }
  }
  changes_until_ = residency_.changes().end();
  examine_retries(now);
  is_built_ = true;
}

void FetchPlan::rebuild(double now) {
  is_built_ = false;
  if (revision_ == index_.revision()) {
    for (const Slot& slot : slots_) slot_of_[slot.file_index] = kNoSlot;
  } else {
    slot_of_.assign(index_.file_order().size(), kNoSlot);
    revision_ = index_.revision();
  }
  slots_.clear();
  retries_.clear();
  for (const std::size_t i : index_.upcoming_layers(deadlines_.playhead(), prefetch_seconds_))
    add_slot(i);
  std::sort(slots_.begin(), slots_.end(),
            [](const Slot& a, const Slot& b) { return a.min_speed < b.min_speed; });
  std::vector<UrgencyTree::Key> keys(slots_.size());
  for (std::uint32_t s = 0; s < slots_.size(); ++s) {
    slot_of_[slots_[s].file_index] = s;
    keys[s] = {current_deadline(s, now), slots_[s].file_index};
  }
  tree_.assign(std::move(keys));
  playhead_ = deadlines_.playhead();
  changes_until_ = residency_.changes().end();
  is_built_ = true;
}

// Adds a layer that may be fetched before the playback position changes.
void FetchPlan::add_slot(std::size_t file_index) {
  const SegmentLayer& layer = index_.file_order()[file_index];
  ++examined_;
  if (!index_.is_needed(layer.segment) || deadlines_.need(layer.segment).from > prefetch_seconds_)
    return;
  slots_.push_back({file_index, min_speed(layer), deadlines_.deadline(layer)});
}

// Returns the deadline of a slot that can be fetched now, else kAbsent.
double FetchPlan::current_deadline(std::uint32_t slot, double now) {
  ++examined_;
  note_retry(slot, now);
  return is_fetchable(layer_of(slot), now) ? slots_[slot].deadline : UrgencyTree::kAbsent;
}

void FetchPlan::examine(std::uint32_t slot, double now) {
  tree_.set(slot, current_deadline(slot, now));
}

// Remembers when to examine a failed layer again.
void FetchPlan::note_retry(std::uint32_t slot, double now) {
  const SegmentLayer& layer = layer_of(slot);
  if (residency_.state(layer) != LoadState::kFailed) return;
  const double at = residency_.retry_at(layer);
  if (at <= now || at == kNever) return;
  retries_.emplace_back(at, slot);
  std::push_heap(retries_.begin(), retries_.end(), std::greater<Retry>());
}

// Examines the layers whose retry is due, and drops outdated retries.
void FetchPlan::examine_retries(double now) {
  while (!retries_.empty()) {
    const auto [at, slot] = retries_.front();
    const SegmentLayer& layer = layer_of(slot);
    const bool is_outdated =
        residency_.state(layer) != LoadState::kFailed || residency_.retry_at(layer) != at;
    if (at > now && !is_outdated) return;
    std::pop_heap(retries_.begin(), retries_.end(), std::greater<Retry>());
    retries_.pop_back();
    if (!is_outdated) examine(slot, now);
  }
}

std::optional<SegmentLayer> FetchPlan::first(double speed) const {
  const auto end =
      std::upper_bound(slots_.begin(), slots_.end(), speed,
                       [](double most, const Slot& slot) { return most < slot.min_speed; });
  const std::size_t slot = tree_.first(static_cast<std::size_t>(end - slots_.begin()));
  if (slot == UrgencyTree::kNone) return {};
  return layer_of(static_cast<std::uint32_t>(slot));
}

}  // namespace stgs::player
