// SPDX-License-Identifier: Apache-2.0
// SegmentStore: decodes fetched segments.
#include <algorithm>
#include <exception>
#include <utility>

#include "stgs/format/parallel.h"
#include "stream/clock_seconds.h"
#include "stream/no_memory.h"
#include "stream/segment_store.h"

namespace stgs::player {
namespace {

// Divisor of the budget: the share that may be decoded at once. Decoding needs about as much
// working memory as its result.
constexpr std::uint64_t kInFlightShare = 16;
// Minimum time without data of another file before the file counts as the right one again, seconds:
// longer than failed layers wait for their retry.
constexpr double kSuspectSeconds = 30;

}  // namespace

// Returns whether a segment is not needed at the playback position yet.
bool SegmentStore::is_ahead(std::uint32_t segment) const {
  return need_for({segment, false}).from > 0;
}

// Returns the most urgent segment that can be decoded, or decoded with spherical harmonics that
// were missing. Segments that are not needed yet leave half of the decoders free for those that a
// seek waits for.
std::optional<std::uint32_t> SegmentStore::next_decode() const {
  const bool only_needed = decoding_.ahead > 0 && 2 * decoding_.ahead >= max_decodes_;
  std::optional<std::uint32_t> best;
  double best_deadline = 0;
  for (std::uint32_t s = 0; s < entries_.size(); ++s) {
    const Entry& entry = entries_[s];
    if (entry.decoding || entry.base.state != LoadState::kResident) continue;
    const bool is_new = entry.resident == nullptr;
    if (!is_new && (entry.has_sh || entry.sh.state != LoadState::kResident)) continue;
    if (only_needed && is_ahead(s)) continue;
    if (const double own = deadline_of({s, !is_new}); !best || own < best_deadline) {
      best_deadline = own;
      best = s;
    }
  }
  return best;
}

// Returns whether there is memory for decoding a segment next to those in flight.
bool SegmentStore::may_decode(std::uint32_t segment) const {
  return decoding_.segments == 0 ||
         decoding_.bytes + memory_of({segment, false}) <= settings_.memory_budget / kInFlightShare;
}

// Decodes a segment. `sh` receives the error of its spherical harmonics alone.
Status SegmentStore::decode(const SceneReader& reader, std::uint32_t segment, bool with_sh,
                            std::shared_ptr<const ResidentSegment>& out, Status& sh) const {
  try {
    Result<Gaussians4D> set =
        with_sh ? reader.decode_intact(segment, sh) : reader.decode(segment, false);
    STGS_TRY(set.status());
    out = std::make_shared<const ResidentSegment>(std::move(set).value(), settings_.memory);
    return {};
  } catch (const std::exception& e) {
    return failure(e, [&] {
      return fmt::format("{}: cannot decode segment {}: {}", source_->name(), segment, e.what());
    });
  }
}

void SegmentStore::run_decoder() {
  const ScopedTaskRunner use(settings_.task_runner);
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    const std::optional<std::uint32_t> segment = next_decode();
    if (!segment || !may_decode(*segment)) {
      to_decode_.wait(lock);
      continue;
    }
    const bool with_sh = entries_[*segment].sh.state == LoadState::kResident;
    const InFlight own = {1, is_ahead(*segment) ? 1 : 0, memory_of({*segment, false})};
    entries_[*segment].decoding = true;
    decoding_ = decoding_.with(own);
    const auto reader = reader_;
    const std::uint64_t generation = generation_;
    lock.unlock();
    std::shared_ptr<const ResidentSegment> decoded;
    Status base, sh;
    run_as_task([&] { base = decode(*reader, *segment, with_sh, decoded, sh); });
    lock.lock();
    decoding_ = decoding_.without(own);
    if (generation == generation_) {
      entries_[*segment].decoding = false;
      insert_decoded(*segment, with_sh, std::move(decoded), base, sh);
    }
    to_decode_.notify_all();
    if (std::exchange(waits_for_memory_, false)) to_fetch_.notify_all();
  }
}

// Records permanent damage. Returns false if there is no memory for that.
bool SegmentStore::record_damage(const SegmentLayer& layer, const Status& status) noexcept {
  try {
    damage_.push_back({layer.segment, layer.sh, status});
    return true;
  } catch (const std::bad_alloc&) {
    return false;
  }
}

void SegmentStore::insert_decoded(std::uint32_t segment, bool with_sh,
                                  std::shared_ptr<const ResidentSegment> decoded,
                                  const Status& base, const Status& sh) noexcept {
  // Recorded damage is permanent, unless the file was replaced: the right one may be restored.
  // Errors of this machine are temporary.
  const auto fail = [this](const SegmentLayer& layer, const Status& status) {
    const bool is_invalid =
        status.code() == StatusCode::kInvalidFile || status.code() == StatusCode::kUnsupported;
    const bool is_replaced =
        is_invalid && !is_live() && (source_->has_shrunk() || source_->was_modified());
    if (is_replaced) {
      set_replaced(true);
      suspect_until_ = clock_seconds() + std::max(kSuspectSeconds, 3 * settings_.retry_seconds);
      evict_sh(layer.segment);  // fetched with it
    }
    const bool damaged = is_invalid && !is_replaced;
    const bool permanently =
        (damaged || status.code() == StatusCode::kNotBuilt) && record_damage(layer, status);
    mark_failed(layer, permanently,
                damaged ? PlayerEvent::Kind::kDamaged : PlayerEvent::Kind::kReadFailed, status);
  };
  Entry& entry = entries_[segment];
  if (!base.ok()) return fail({segment, false}, base);
  set_resident(segment, std::move(decoded));
  entry.base.backoff = 0;
  entry.has_sh = with_sh && sh.ok();
  if (!sh.ok()) return fail({segment, true}, sh);
  // This data was fetched after the file was replaced, so the file is the right one again, and
  // further changes count as another replacement.
  if (is_replaced_ && clock_seconds() > suspect_until_ && !source_->has_shrunk()) {
    source_->set_finished();
    set_replaced(false);
  }
  if (!entry.has_sh) return;
  // The segment is completely decoded: its encoded bytes are no longer needed.
  for (const bool is_sh : {false, true}) {
    const SegmentLayer layer{segment, is_sh};
    if (stored_bytes(layer) == 0) continue;
    source_->erase(file_offset(layer));
    set_memory(layer, state_of(layer).memory - stored_bytes(layer));
  }
  entry.sh.backoff = 0;
}

}  // namespace stgs::player
