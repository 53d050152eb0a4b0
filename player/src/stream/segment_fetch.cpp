// SPDX-License-Identifier: Apache-2.0
// What is fetched next, and fetching it.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <limits>
#include <utility>

#include "stream/clock_seconds.h"
#include "stream/no_memory.h"
#include "stream/segment_store.h"

namespace stgs::player {
namespace {

constexpr double kForEver = std::numeric_limits<double>::infinity();
// Of a run that is not longer for its first piece, bytes; and between its pieces.
constexpr std::uint64_t kRun = 512 << 10, kGap = 4 << 10;
constexpr double kBrief = 0.1;  // seconds that a run of pieces of any urgency may take
// Seconds and bytes asked for at once: what a jump has to wait for.
constexpr double kStretch = 0.25;
constexpr double kLongStretch = 2 * kStretch;  // after which a jump ends one
constexpr double kLeastStretch = 64 << 10, kGreatestStretch = 1 << 20;
// Seconds for which a piece that the viewer waits for has the link to itself.
constexpr double kAlone = 1;

}  // namespace

// Whether a piece is still to be fetched, and soon enough to begin with it.
bool SegmentStore::wanted(const Piece& piece, double now) const {
  if (!reader_->segments()[piece.segment].is_shown()) return false;
  const Entry& entry = entries_[piece.segment];
  const PieceState& own = state(piece);
  if (own.at != At::kAway && !(own.at == At::kLost && now >= own.retry)) return false;
  if (piece.harmonics && entry.base.at != At::kHere && entry.base.at != At::kComing) return false;
  return need_for(piece).from <= farthest_ahead();
}

// Whether a piece can come before the last moment that it is for, as the link is; layer 0 always is
// tried.
bool SegmentStore::in_time(const Piece& piece) const {
  const double speed = throughput_.bytes_per_second();
  if (layer_of(reader_->segments()[piece.segment], piece.harmonics, tiers_) == 0 || speed == 0) {
    return true;
  }
  return static_cast<double>(piece_bytes(piece)) / speed <= need_for(piece).until;
}

// Whether something is under way that the viewer waits for, and has not been for long.
bool SegmentStore::is_waited_for(double now) const {
  return std::any_of(running_.begin(), running_.end(), [&](const Run& run) {
    return run.generation == generation_ && urgency_of(run.pieces[0].piece) <= 0 &&
           now < run.begun + kAlone;
  });
}

// Pieces that the viewer comes to as far ahead as is fetched, and some around them, by their places
// in the file.
std::vector<std::size_t> SegmentStore::pieces_ahead() const {
  constexpr double kAround = 1;  // ticks: which are near enough is asked of each
  const double speed = std::abs(motion_.ticks_per_second);
  const double ahead = farthest_ahead() * speed, at = motion_.ticks, end = motion_.duration;
  const bool back = motion_.ticks_per_second < 0;
  std::vector<std::uint32_t> near =
      back ? reader_->segments_between(at - ahead - kAround, at + kAround)
           : reader_->segments_between(at - kAround, at + ahead + kAround);
  if (const double round = back ? end + at - ahead : at + ahead - end; motion_.loop) {
    const auto more = back ? reader_->segments_between(std::max(round, at) - kAround, end)
                           : reader_->segments_between(0, std::min(round, at) + kAround);
    near.insert(near.end(), more.begin(), more.end());
  }
  std::vector<std::size_t> out;
  for (const std::uint32_t segment : near) {
    for (const bool harmonics : {false, true}) {
      if (piece_bytes({segment, harmonics}) > 0) out.push_back(place_of({segment, harmonics}));
    }
  }
  // In this order the first of those that are alike is taken; what is near both ways is here twice.
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

// The most urgent piece. While the viewer waits for one, nothing else takes bandwidth from it. What
// comes too late is tried only where nothing else is under way: the link may have become better.
std::optional<Piece> SegmentStore::next_piece(double now) const {
  const bool only_waited_for = is_waited_for(now);
  std::optional<Piece> best, late;
  double least = kForEver, least_late = kForEver;
  for (const std::size_t place : pieces_ahead()) {
    const Piece& piece = in_file_[place];
    if (!wanted(piece, now)) continue;
    const double urgency = urgency_of(piece);
    if (only_waited_for && urgency > 0) continue;
    if (urgency < least && in_time(piece)) {
      least = urgency;
      best = piece;
    } else if (urgency < least_late) {
      least_late = urgency;
      late = piece;
    }
  }
  return best || !running_.empty() ? best : late;
}

// Marks a piece as coming if there is room for it.
bool SegmentStore::take(const Piece& piece, double urgency) {
  if (!make_room(memory_of(piece), urgency)) return false;
  if (urgency >= full_from_) full_from_ = kForEver;
  count(piece, memory_of(piece));
  state(piece).at = At::kComing;
  return true;
}

// Whether decoding is about to leave room.
bool SegmentStore::is_decoding() const {
  return under_way_.segments > 0 || next_decode();
}

// Puts the next run into `taken`; false where there is none. What throws leaves there what is
// to be given back.
bool SegmentStore::next_run(double now, Runs& taken) {
  if (!is_placed_) return false;
  const std::optional<Piece> first = next_piece(now);
  if (!first) return false;
  const double urgency = urgency_of(*first);
  const std::uint64_t offset = piece_offset(*first), bytes = piece_bytes(*first);
  taken.push_back({offset, bytes, {{*first, offset, bytes}}, jumps_, now, generation_});
  if (!take(*first, urgency)) {
    taken.pop_back();
    is_full_ = true;
    const bool no_more_room = running_.empty() && !is_decoding();
    if (no_more_room) full_from_ = std::min(full_from_, urgency);
    // What the viewer waits for and cannot have is passed over, or he would wait for ever.
    const bool layer0 =
        layer_of(reader_->segments()[first->segment], first->harmonics, tiers_) == 0;
    if (layer0 && no_more_room && need_for(*first).from <= settings_.resume_seconds) {
      lose(*first, false, PlayerEvent::Kind::kReadFailed,
           runtime_error("{}: what is alive takes more memory than the {} bytes allowed",
                         source_->name(), settings_.memory_budget));
    }
    return false;
  }
  extend(taken.back(), urgency, now);
  return true;
}

// Adds what follows in the file: what is about as urgent as the first piece, which it makes later,
// and what comes sooner with it than by a request of its own.
void SegmentStore::extend(Run& run, double urgency, double now) {
  const Piece first = run.pieces[0].piece;
  const double alike = urgency <= 0 ? 0 : urgency + settings_.layer_lead_seconds;
  const double brief = urgency <= 0 ? 0 : kBrief * throughput_.bytes_per_second();
  std::size_t at = place_of(first);
  while (++at < in_file_.size()) {
    const Piece& piece = in_file_[at];
    const std::uint64_t end = run.offset + run.bytes, begin = piece_offset(piece);
    if (begin < end || begin - end > kGap) return;
    const std::uint64_t bytes = begin - run.offset + piece_bytes(piece);
    const double most = static_cast<double>(bytes) <= brief ? kForEver : alike;
    if (bytes > kRun || !wanted(piece, now) || !in_time(piece) || urgency_of(piece) > most) return;
    run.pieces.push_back({piece, begin, piece_bytes(piece)});
    if (!take(piece, urgency_of(piece))) return run.pieces.pop_back();
    run.bytes = bytes;
  }
}

// A run that was not begun.
void SegmentStore::give_back(const Run& run) noexcept {
  for (const PlacedPiece& own : run.pieces) {
    if (state(own.piece).at == At::kComing) release(own.piece, At::kAway);
  }
}

void SegmentStore::fetch_pieces() {
  bool is_short = false;  // of memory, which is told once
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    Runs own;
    bool found = false;
    try {
      found = next_run(clock_seconds(), own);
      is_short = false;
    } catch (const std::exception& e) {
      for (const Run& run : own) give_back(run);
      if (!std::exchange(is_short, true)) {
        add_event(event_of(PlayerEvent::Kind::kReadFailed, 0, code_of(e), kNoMemory));
      }
    }
    if (!found) {
      // Not for ever: what was lost is tried again.
      to_fetch_.wait_for(lock, std::chrono::milliseconds(100));
      continue;
    }
    running_.splice(running_.begin(), own);
    const auto run = running_.begin();
    throughput_.begin(clock_seconds());
    lock.unlock();
    std::vector<std::uint8_t> bytes;
    Status status;
    try {
      status = fetch(*run, bytes);
      if (status.ok() && bytes.size() == run->bytes) put(*run, bytes);
    } catch (const std::exception& e) {
      bytes.clear();
      status = failure(e, [&] {
        return fmt::format("{}: cannot hold {} bytes: {}", source_->name(), run->bytes, e.what());
      });
    }
    const bool came = status.ok() && bytes.size() == run->bytes;
    lock.lock();
    throughput_.end(clock_seconds());
    own.splice(own.begin(), running_, run);
    settle(own.front(), came, status);
    to_fetch_.notify_all();
  }
}

std::size_t SegmentStore::stretch_of(const Run& run) const {
  const std::lock_guard lock(mutex_);
  const double speed = throughput_.bytes_per_second();
  const double bytes =
      speed > 0 ? std::clamp(kStretch * speed, kLeastStretch, kGreatestStretch) : kGreatestStretch;
  return static_cast<std::size_t>(std::min(bytes, static_cast<double>(run.bytes)));
}

// Whether the rest of a run is not worth its time: after a jump there is something more urgent.
bool SegmentStore::given_up(const Run& run) const {
  return stopping_ || run.generation != generation_ ||
         (run.jumps != jumps_ && urgency_of(run.pieces[0].piece) > settings_.layer_lead_seconds);
}

// Whether nothing of a run that is at or behind a place in the file is needed soon where the viewer
// has jumped to.
bool SegmentStore::is_needless(const Run& run, std::uint64_t from) const {
  if (stopping_ || run.generation != generation_) return true;
  const auto needless = [&](const PlacedPiece& own) {
    return own.offset + own.bytes <= from ||
           need_for(own.piece).from > settings_.layer_lead_seconds;
  };
  return run.jumps != jumps_ && std::all_of(run.pieces.begin(), run.pieces.end(), needless);
}

// The bytes of a run; none where it is given up.
Status SegmentStore::fetch(const Run& run, std::vector<std::uint8_t>& bytes) {
  bytes.resize(static_cast<std::size_t>(run.bytes));
  for (std::size_t done = 0; done < bytes.size();) {
    const std::size_t part = std::min(stretch_of(run), bytes.size() - done);
    // To end a stretch before it has come costs its connection.
    const double begun = clock_seconds();
    bool ended = false;
    const auto should_continue = [&] {
      if (clock_seconds() - begun < kLongStretch) return true;
      const std::lock_guard lock(mutex_);
      return !(ended = is_needless(run, run.offset + done));
    };
    bool read = false;
    const Status status = source_->fetch(should_continue, run.offset + done,
                                         std::span(bytes).subspan(done, part), read);
    done += part;
    if (!status.ok() && !ended) return status;
    const std::lock_guard lock(mutex_);
    if (status.ok() && read) throughput_.add_bytes(part, clock_seconds());
    if (status.ok()) fetched_bytes_ += part;
    if (!status.ok()) throughput_.forget();  // it may have stood still
    if (!status.ok() || (done < bytes.size() && given_up(run))) {
      bytes.clear();
      return {};
    }
  }
  return {};
}

void SegmentStore::put(const Run& run, std::span<const std::uint8_t> bytes) {
  for (const PlacedPiece& own : run.pieces) {
    source_->put(own.offset, bytes.subspan(static_cast<std::size_t>(own.offset - run.offset),
                                           static_cast<std::size_t>(own.bytes)));
  }
}

// After a run that has come, was given up, or failed.
void SegmentStore::settle(const Run& run, bool came, const Status& status) noexcept {
  for (const auto& [piece, offset, bytes] : run.pieces) {
    if (run.generation != generation_) {
      source_->drop(offset);
    } else if (came) {
      state(piece).at = At::kHere;
    } else {
      release(piece, At::kAway);
      if (!status.ok() && !stopping_) lose(piece, false, PlayerEvent::Kind::kReadFailed, status);
    }
  }
  to_decode_.notify_all();
  if (!status.ok() && !is_followed() && source_->has_shrunk()) note_change(true);
  // What a link carried before it failed tells nothing of what it carries after.
  if (!status.ok()) throughput_.forget();
}

// By somebody who looks himself whether it is another file.
bool SegmentStore::is_followed() const {
  return settings_.live.follow && reader_->form() == SceneForm::kGrowing;
}

void SegmentStore::note_change(bool changed) noexcept {
  if (std::exchange(is_changed_, changed) != changed) on_changed_(changed);
}

}  // namespace stgs::player
