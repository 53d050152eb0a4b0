// SPDX-License-Identifier: Apache-2.0
#include "stream/decode_queue.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace stgs::player {

void DecodeQueue::reserve(std::size_t segments) {
  if (segments <= needed_.size()) return;
  std::vector<UrgencyTree::Key> keys(std::max(segments, 2 * needed_.size()));
  for (std::size_t s = 0; s < keys.size(); ++s) keys[s].rank = s;  // ties go to the first one
  UrgencyTree needed, later;
  needed.assign(keys);
  later.assign(std::move(keys));
  needed_ = std::move(needed);
  later_ = std::move(later);
  is_built_ = false;
}

// Adopts the present state of all segments. A new playback position or reader takes O(n log n) for
// n decodable segments, each change of one O(log n).
void DecodeQueue::update() noexcept {
  const auto changes = residency_.decode_changes().since(changes_until_);
  changes_until_ = residency_.decode_changes().end();
  if (is_built_ && changes && revision_ == index_.revision() &&
      playhead_ == deadlines_.playhead()) {
    for (const std::uint32_t segment : *changes) examine(segment);
    return;
  }
  for (UrgencyTree* tree : {&needed_, &later_}) {
    for (std::size_t s; (s = tree->first(tree->size())) != UrgencyTree::kNone;)
      tree->set(s, UrgencyTree::kAbsent);
  }
  for (const std::uint32_t segment : residency_.decodable()) examine(segment);
  revision_ = index_.revision();
  playhead_ = deadlines_.playhead();
  is_built_ = true;
}

void DecodeQueue::examine(std::uint32_t segment) noexcept {
  // Segments that are not needed any more come last.
  constexpr double kLast = std::numeric_limits<double>::max();
  ++examined_;
  double now = UrgencyTree::kAbsent, later = UrgencyTree::kAbsent;
  if (residency_.is_decodable(segment)) {
    const bool is_new = residency_.resident(segment) == nullptr;
    (deadlines_.is_ahead(segment) ? later : now) =
        std::min(deadlines_.deadline({segment, !is_new}), kLast);
  }
  needed_.set(segment, now);
  later_.set(segment, later);
}

// Returns the most urgent segment that can be decoded, or decoded with spherical harmonics that
// were missing. Segments that are not needed yet leave half of the jobs free for those that a seek
// waits for.
std::optional<std::uint32_t> DecodeQueue::next_segment() noexcept {
  update();
  const bool only_needed = ahead_ > 0 && 2 * ahead_ >= executor_.max_jobs();
  const std::size_t now = needed_.first(needed_.size());
  const std::size_t later = only_needed ? UrgencyTree::kNone : later_.first(later_.size());
  if (now == UrgencyTree::kNone && later == UrgencyTree::kNone) return {};
  const bool is_now =
      later == UrgencyTree::kNone ||
      (now != UrgencyTree::kNone && needed_.key(now).comes_before(later_.key(later)));
  return static_cast<std::uint32_t>(is_now ? now : later);
}

std::optional<DecodeJob> DecodeQueue::next() noexcept {
  if (in_flight_ >= executor_.max_jobs()) return std::nullopt;
  const std::optional<std::uint32_t> segment = next_segment();
  if (!segment) return std::nullopt;
  const std::uint64_t bytes = executor_.scratch_bytes(index_.reader(), *segment);
  constexpr auto kPool = Budget::Pool::kDecodeScratch;
  std::optional<Lease> scratch = in_flight_ == 0 ? std::optional(budget_.charge(kPool, bytes))
                                                 : budget_.try_charge(kPool, bytes);
  if (!scratch) return std::nullopt;
  const bool with_sh = residency_.state({*segment, true}) == LoadState::kResident;
  const bool ahead = deadlines_.is_ahead(*segment);
  residency_.begin_decode(*segment);
  ++in_flight_;
  ahead_ += ahead ? 1 : 0;
  return DecodeJob{
      *segment, with_sh, index_.snapshot().reader, index_.generation(), ahead, std::move(*scratch)};
}

bool DecodeQueue::finish(const DecodeJob& job) noexcept {
  --in_flight_;
  ahead_ -= job.ahead ? 1 : 0;
  if (job.generation != index_.generation()) return false;
  residency_.end_decode(job.segment);
  return true;
}

}  // namespace stgs::player
