// SPDX-License-Identifier: Apache-2.0
// Decoding what has been fetched.
#include <algorithm>
#include <exception>
#include <utility>

#include "stgs/format/parallel.h"
#include "stream/clock_seconds.h"
#include "stream/no_memory.h"
#include "stream/segment_store.h"

namespace stgs::player {

namespace {

// Share of the budget that may be under way: decoding takes about as much again as it leaves.
constexpr std::uint64_t kUnderWayShare = 16;
// Seconds at least without a piece of another file after which it is taken for the right one again:
// longer than what is lost is left alone.
constexpr double kDoubtSeconds = 30;

}  // namespace

bool SegmentStore::is_ahead(std::uint32_t segment) const {
  return need_for({segment, false}).from > 0;
}

// The most urgent segment that can be decoded better than it is. What is not needed yet leaves half
// of the decoders free for what a viewer who jumps waits for.
std::optional<std::uint32_t> SegmentStore::next_decode() const {
  const bool only_needed = under_way_.ahead > 0 && 2 * under_way_.ahead >= decoders_;
  std::optional<std::uint32_t> best;
  double least = 0;
  for (std::uint32_t s = 0; s < entries_.size(); ++s) {
    const Entry& entry = entries_[s];
    if (entry.decoding || entry.base.at != At::kHere) continue;
    const bool better = entry.held == nullptr;
    if (!better && (entry.with_harmonics || entry.harmonics.at != At::kHere)) continue;
    if (only_needed && is_ahead(s)) continue;
    if (const double u = urgency_of({s, !better}); !best || u < least) {
      least = u;
      best = s;
    }
  }
  return best;
}

// Whether a segment may be begun beside those that are under way.
bool SegmentStore::may_begin(std::uint32_t segment) const {
  return under_way_.segments == 0 ||
         under_way_.bytes + memory_of({segment, false}) <= settings_.memory_budget / kUnderWayShare;
}

// `harmonics`: what is wrong with these alone.
Status SegmentStore::decode(const SceneReader& reader, std::uint32_t segment, bool with_harmonics,
                            std::shared_ptr<const ResidentSegment>& held, Status& harmonics) const {
  try {
    Result<Gaussians4D> set =
        with_harmonics ? reader.decode_intact(segment, harmonics) : reader.decode(segment, false);
    STGS_TRY(set.status());
    held = std::make_shared<const ResidentSegment>(std::move(set).value(), settings_.memory);
    return {};
  } catch (const std::exception& e) {
    return failure(e, [&] {
      return fmt::format("{}: cannot hold segment {}: {}", source_->name(), segment, e.what());
    });
  }
}

void SegmentStore::decode_segments() {
  const ScopedTaskRunner use(settings_.task_runner);
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    const std::optional<std::uint32_t> segment = next_decode();
    if (!segment || !may_begin(*segment)) {
      to_decode_.wait(lock);
      continue;
    }
    const bool with_harmonics = entries_[*segment].harmonics.at == At::kHere;
    const UnderWay own = {1, is_ahead(*segment) ? 1 : 0, memory_of({*segment, false})};
    entries_[*segment].decoding = true;
    under_way_ = under_way_.with(own);
    const auto reader = reader_;
    const std::uint64_t generation = generation_;
    lock.unlock();
    std::shared_ptr<const ResidentSegment> held;
    Status harmonics;
    Status base;
    run_as_task([&] { base = decode(*reader, *segment, with_harmonics, held, harmonics); });
    lock.lock();
    under_way_ = under_way_.without(own);
    if (generation == generation_) {
      entries_[*segment].decoding = false;
      take_decoded(*segment, with_harmonics, std::move(held), base, harmonics);
    }
    to_decode_.notify_all();
    if (std::exchange(is_full_, false)) to_fetch_.notify_all();
  }
}

// false: there is no memory for that.
bool SegmentStore::note_loss(const Piece& piece, const Status& status) noexcept {
  try {
    losses_.push_back({piece.segment, piece.harmonics, status});
    return true;
  } catch (const std::bad_alloc&) {
    return false;
  }
}

void SegmentStore::take_decoded(std::uint32_t segment, bool with_harmonics,
                                std::shared_ptr<const ResidentSegment> held, const Status& base,
                                const Status& harmonics) noexcept {
  // Damage stays, once it has been noted, but that of another file, which may be put back; what
  // this machine could not do now it may do later.
  const auto lost = [this](const Piece& piece, const Status& status) {
    const bool wrong =
        status.code() == StatusCode::kInvalidFile || status.code() == StatusCode::kUnsupported;
    const bool of_another =
        wrong && !is_followed() && (source_->has_shrunk() || source_->was_modified());
    if (of_another) {
      note_change(true);
      doubtful_until_ = clock_seconds() + std::max(kDoubtSeconds, 3 * settings_.retry_seconds);
      drop_harmonics(piece.segment);  // which came with it
    }
    const bool damaged = wrong && !of_another;
    const bool for_ever =
        (damaged || status.code() == StatusCode::kNotBuilt) && note_loss(piece, status);
    lose(piece, for_ever, damaged ? PlayerEvent::Kind::kDamaged : PlayerEvent::Kind::kReadFailed,
         status);
  };
  Entry& entry = entries_[segment];
  if (!base.ok()) return lost({segment, false}, base);
  hold(segment, std::move(held));
  entry.base.patience = 0;
  entry.with_harmonics = with_harmonics && harmonics.ok();
  if (!harmonics.ok()) return lost({segment, true}, harmonics);
  // It is right again, if this was not fetched before it was wrong: what it is now is to stay.
  if (is_changed_ && clock_seconds() > doubtful_until_ && !source_->has_shrunk()) {
    source_->set_finished();
    note_change(false);
  }
  if (!entry.with_harmonics) return;
  // All of it is decoded: its bytes are not needed any more.
  for (const bool which : {false, true}) {
    const Piece piece{segment, which};
    if (piece_bytes(piece) == 0) continue;
    source_->drop(piece_offset(piece));
    count(piece, state(piece).memory - piece_bytes(piece));
  }
  entry.harmonics.patience = 0;
}

}  // namespace stgs::player
