// SPDX-License-Identifier: Apache-2.0
#include "stream/decode_queue.h"

#include <utility>

namespace stgs::player {

// Returns the most urgent segment that can be decoded, or decoded with spherical harmonics that
// were missing. Segments that are not needed yet leave half of the jobs free for those that a seek
// waits for.
std::optional<std::uint32_t> DecodeQueue::next_segment() const {
  const bool only_needed = ahead_ > 0 && 2 * ahead_ >= executor_.max_jobs();
  std::optional<std::uint32_t> best;
  double best_deadline = 0;
  for (const std::uint32_t s : residency_.decodable()) {
    if (only_needed && deadlines_.is_ahead(s)) continue;
    const bool is_new = residency_.resident(s) == nullptr;
    const double own = deadlines_.deadline({s, !is_new});
    // Ties go to the first segment of the file.
    if (!best || own < best_deadline || (own == best_deadline && s < *best)) {
      best_deadline = own;
      best = s;
    }
  }
  return best;
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
