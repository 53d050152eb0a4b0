// SPDX-License-Identifier: Apache-2.0
#include "stream/segment_store.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <limits>
#include <utility>

namespace stgs::player {
namespace {

constexpr std::size_t kStretch = 1 << 20;  // bytes asked for at once: what a jump has to wait for
// Of a run that is not longer for its first piece, bytes; and between its pieces.
constexpr std::uint64_t kRun = 512 << 10, kGap = 4 << 10;
constexpr double kBrief = 0.1;  // seconds that a run of pieces of any urgency may take
constexpr double kForEver = std::numeric_limits<double>::infinity();

double clock_seconds() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

}  // namespace

SegmentStore::SegmentStore(std::unique_ptr<SceneReader> reader, PieceSource& source,
                           const PlayerSettings& settings)
    : reader_(std::move(reader)), source_(source), settings_(settings) {
  const std::vector<SegmentInfo>& segments = reader_->segments();
  for (const SegmentInfo& segment : segments) tiers_ = std::max(tiers_, segment.tier + 1);
  entries_.resize(segments.size());
  for (std::size_t s = 0; s < segments.size(); ++s) {
    if (!segments[s].there) entries_[s].base = {At::kLost, kForEver};
    if (!segments[s].harmonics_there) entries_[s].harmonics = {At::kLost, kForEver};
    if (segments[s].harmonics_bytes == 0) entries_[s].harmonics.at = At::kHere;
  }
  for (std::uint32_t s = 0; s < segments.size(); ++s) {
    for (const bool harmonics : {false, true}) {
      if (piece_bytes({s, harmonics}) > 0) in_file_.push_back({s, harmonics});
    }
  }
  std::sort(in_file_.begin(), in_file_.end(),
            [this](const Piece& a, const Piece& b) { return piece_offset(a) < piece_offset(b); });
  places_.resize(2 * segments.size());
  for (std::size_t i = 0; i < in_file_.size(); ++i) {
    places_[2 * std::size_t{in_file_[i].segment} + (in_file_[i].harmonics ? 1 : 0)] = i;
  }
  motion_.duration = reader_->metadata().frames;
  for (int k = 0; k < settings_.fetches; ++k) threads_.emplace_back([this] { fetch_pieces(); });
  threads_.emplace_back([this] { decode_segments(); });
}

SegmentStore::~SegmentStore() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  to_fetch_.notify_all();
  to_decode_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void SegmentStore::move(const Motion& motion, bool jumped) {
  {
    const std::lock_guard lock(mutex_);
    motion_ = motion;
    jumps_ += jumped ? 1 : 0;
  }
  to_fetch_.notify_all();
  to_decode_.notify_one();
}

std::shared_ptr<const HeldSegment> SegmentStore::held(std::uint32_t segment) const {
  const std::lock_guard lock(mutex_);
  return entries_[segment].held;
}

bool SegmentStore::settled(std::uint32_t segment) const {
  return entries_[segment].held != nullptr || entries_[segment].base.at == At::kLost ||
         !reader_->segments()[segment].shown();
}

bool SegmentStore::ready(double ticks) const {
  const std::vector<std::uint32_t> alive = reader_->segments_between(ticks, ticks);
  const std::lock_guard lock(mutex_);
  return std::all_of(alive.begin(), alive.end(), [this](std::uint32_t s) {
    return reader_->segments()[s].tier > 0 || settled(s);
  });
}

std::vector<TickRange> SegmentStore::ready_ranges() const {
  std::vector<TickRange> gaps;
  {
    const std::lock_guard lock(mutex_);
    for (std::uint32_t s = 0; s < entries_.size(); ++s) {
      const SegmentInfo& segment = reader_->segments()[s];
      if (segment.tier == 0 && !settled(s))
        gaps.push_back({segment.begin_ticks, segment.end_ticks});
    }
  }
  std::sort(gaps.begin(), gaps.end(),
            [](const TickRange& a, const TickRange& b) { return a.begin < b.begin; });
  std::vector<TickRange> ranges;
  double at = 0;
  const double end = reader_->metadata().frames;
  for (const TickRange& gap : gaps) {
    if (gap.begin > at) ranges.push_back({at, std::min(gap.begin, end)});
    at = std::max(at, gap.end);
  }
  if (at < end) ranges.push_back({at, end});
  return ranges;
}

int SegmentStore::layers(double ticks) const {
  const std::vector<std::uint32_t> alive = reader_->segments_between(ticks, ticks);
  const std::lock_guard lock(mutex_);
  int layers = 2 * tiers_;
  for (std::uint32_t s : alive) {
    const SegmentInfo& segment = reader_->segments()[s];
    const Entry& entry = entries_[s];
    if (entry.held == nullptr) {
      layers = std::min(layers, layer_of(segment, false, tiers_));
    } else if (!entry.with_harmonics) {
      layers = std::min(layers, layer_of(segment, true, tiers_));
    }
  }
  return layers;
}

StreamStatistics SegmentStore::statistics() const {
  const std::lock_guard lock(mutex_);
  StreamStatistics out;
  out.bytes_per_second = throughput_.bytes_per_second();
  out.fetched_bytes = fetched_bytes_;
  out.memory_bytes = memory_;
  for (const Entry& entry : entries_) {
    if (entry.held != nullptr) out.stored_primitives += entry.held->set.size();
  }
  return out;
}

std::vector<PlayerEvent> SegmentStore::take_events() {
  const std::lock_guard lock(mutex_);
  return std::exchange(events_, {});
}

std::vector<Loss> SegmentStore::losses() const {
  const std::lock_guard lock(mutex_);
  return losses_;
}

void SegmentStore::tell(PlayerEvent event) {
  const std::lock_guard lock(mutex_);
  event.seconds = reader_->metadata().time_base.seconds(motion_.ticks);
  events_.push_back(std::move(event));
}

std::uint64_t SegmentStore::piece_bytes(const Piece& piece) const {
  const SegmentInfo& segment = reader_->segments()[piece.segment];
  return piece.harmonics ? segment.harmonics_bytes : segment.bytes;
}

std::uint64_t SegmentStore::piece_offset(const Piece& piece) const {
  const SegmentInfo& segment = reader_->segments()[piece.segment];
  return piece.harmonics ? segment.harmonics_offset : segment.offset;
}

std::uint64_t SegmentStore::memory_of(const Piece& piece) const {
  const SegmentInfo& segment = reader_->segments()[piece.segment];
  const std::uint64_t decoded =
      piece.harmonics ? 0 : held_bytes(segment.primitives, reader_->sh_degree());
  return piece_bytes(piece) + decoded;
}

double SegmentStore::urgency_of(const Piece& piece) const {
  const SegmentInfo& segment = reader_->segments()[piece.segment];
  return urgency(need_of(segment.begin_ticks, segment.end_ticks, motion_),
                 layer_of(segment, piece.harmonics, tiers_), settings_.layer_patience_seconds);
}

// Whether a piece is still to be fetched, and soon enough to begin with it.
bool SegmentStore::wanted(const Piece& piece, double now) const {
  if (!reader_->segments()[piece.segment].shown()) return false;
  const Entry& entry = entries_[piece.segment];
  const PieceState& state = piece.harmonics ? entry.harmonics : entry.base;
  if (state.at != At::kAway && !(state.at == At::kLost && now >= state.retry)) return false;
  if (piece.harmonics && entry.base.at != At::kHere && entry.base.at != At::kComing) return false;
  const SegmentInfo& segment = reader_->segments()[piece.segment];
  const Need need = need_of(segment.begin_ticks, segment.end_ticks, motion_);
  return need.from <= settings_.ahead_seconds && in_time(piece);
}

// Whether a piece can come before the last moment that it is for, as the link is; layer 0 always is
// tried.
bool SegmentStore::in_time(const Piece& piece) const {
  const SegmentInfo& segment = reader_->segments()[piece.segment];
  const double speed = throughput_.bytes_per_second();
  if (layer_of(segment, piece.harmonics, tiers_) == 0 || speed == 0) return true;
  const Need need = need_of(segment.begin_ticks, segment.end_ticks, motion_);
  return static_cast<double>(piece_bytes(piece)) / speed <= need.until;
}

// The most urgent piece. While the viewer waits for one, nothing else takes bandwidth from it.
std::optional<Piece> SegmentStore::next_piece(double now) const {
  std::optional<Piece> best;
  double least = urgent_ > 0 ? std::numeric_limits<double>::min() : kForEver;
  for (const Piece& piece : in_file_) {
    if (!wanted(piece, now)) continue;
    if (const double urgency = urgency_of(piece); urgency < least) {
      least = urgency;
      best = piece;
    }
  }
  return best;
}

// Marks a piece as coming if there is room for it.
bool SegmentStore::take(const Piece& piece, double urgency) {
  if (!make_room(memory_of(piece), urgency)) return false;
  memory_ += memory_of(piece);
  state(piece).at = At::kComing;
  return true;
}

std::optional<SegmentStore::Run> SegmentStore::next_run(double now) {
  const std::optional<Piece> first = next_piece(now);
  if (!first) return {};
  const double urgency = urgency_of(*first);
  if (!take(*first, urgency)) {
    if (urgency <= 0 && idle()) {
      lose(*first, settings_.retry_seconds, PlayerEvent::Kind::kLost,
           runtime_error("{}: what is alive takes more memory than the {} bytes allowed",
                         source_.name(), settings_.memory_budget));
    }
    return {};
  }
  Run run{piece_offset(*first), piece_bytes(*first), {*first}};
  extend(run, urgency, now);
  if (urgency <= 0) ++urgent_;
  return run;
}

// Adds what follows in the file: what is about as urgent as the first piece, which it makes later,
// and what comes sooner with it than by a request of its own.
void SegmentStore::extend(Run& run, double urgency, double now) {
  const Piece& first = run.pieces[0];
  const double alike = urgency <= 0 ? 0 : urgency + settings_.layer_patience_seconds;
  const double brief = urgency <= 0 ? 0 : kBrief * throughput_.bytes_per_second();
  std::size_t at = places_[2 * std::size_t{first.segment} + (first.harmonics ? 1 : 0)];
  while (++at < in_file_.size()) {
    const Piece& piece = in_file_[at];
    const std::uint64_t end = run.offset + run.bytes, begin = piece_offset(piece);
    if (begin < end || begin - end > kGap) return;
    const std::uint64_t bytes = begin - run.offset + piece_bytes(piece);
    const double most = static_cast<double>(bytes) <= brief ? kForEver : alike;
    if (bytes > kRun || !wanted(piece, now) || urgency_of(piece) > most) return;
    if (!take(piece, urgency_of(piece))) return;
    run.bytes = bytes;
    run.pieces.push_back(piece);
  }
}

// Whether nothing is under way.
bool SegmentStore::idle() const {
  return std::none_of(entries_.begin(), entries_.end(), [](const Entry& e) {
    return e.decoding || e.base.at == At::kComing || e.harmonics.at == At::kComing;
  });
}

// Drops what is needed later than `urgency`, the latest first, until `bytes` more fit.
bool SegmentStore::make_room(std::uint64_t bytes, double urgency) {
  while (memory_ + bytes > settings_.memory_budget) {
    std::optional<std::uint32_t> latest;
    double most = urgency;
    for (std::uint32_t s = 0; s < entries_.size(); ++s) {
      const Entry& entry = entries_[s];
      const bool idle =
          entry.base.at == At::kHere && !entry.decoding && entry.harmonics.at != At::kComing;
      if (!idle) continue;
      if (const double u = urgency_of({s, false}); u > most) {
        most = u;
        latest = s;
      }
    }
    if (!latest) return false;
    drop(*latest);
  }
  return true;
}

void SegmentStore::drop(std::uint32_t segment) {
  Entry& entry = entries_[segment];
  for (const bool harmonics : {false, true}) {
    const Piece piece{segment, harmonics};
    if (piece_bytes(piece) == 0 || state(piece).at != At::kHere) continue;
    source_.drop(piece_offset(piece));
    memory_ -= memory_of(piece);
    state(piece).at = At::kAway;
  }
  entry.held = nullptr;
  entry.with_harmonics = false;
}

void SegmentStore::fetch_pieces() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    const std::optional<Run> run = next_run(clock_seconds());
    if (!run) {
      // Not for ever: what was lost is tried again.
      to_fetch_.wait_for(lock, std::chrono::milliseconds(100));
      continue;
    }
    const bool urgent = urgency_of(run->pieces[0]) <= 0;
    throughput_.begin(clock_seconds());
    lock.unlock();
    std::vector<std::uint8_t> bytes;
    Status status;
    try {
      status = fetch(*run, bytes);
      if (status.ok() && bytes.size() == run->bytes) put(*run, bytes);
    } catch (const std::exception& e) {
      bytes.clear();
      status = runtime_error("{}: cannot hold {} bytes: {}", source_.name(), run->bytes, e.what());
    }
    lock.lock();
    throughput_.end(clock_seconds());
    if (urgent && --urgent_ == 0) to_fetch_.notify_all();
    if (!status.ok() || bytes.size() != run->bytes) {
      give_back(*run, status);
      continue;
    }
    for (const Piece& piece : run->pieces) state(piece).at = At::kHere;
    to_decode_.notify_one();
  }
}

// The bytes of a run; none where after a jump there is something more urgent.
Status SegmentStore::fetch(const Run& run, std::vector<std::uint8_t>& bytes) {
  bytes.resize(static_cast<std::size_t>(run.bytes));
  std::uint64_t jumps = 0;
  for (std::uint64_t done = 0; done < run.bytes;) {
    const auto part = static_cast<std::size_t>(std::min<std::uint64_t>(kStretch, run.bytes - done));
    STGS_TRY(source_.under().read(run.offset + done,
                                  std::span(bytes).subspan(static_cast<std::size_t>(done), part)));
    done += part;
    const std::lock_guard lock(mutex_);
    throughput_.arrived(part, clock_seconds());
    fetched_bytes_ += part;
    if (done == part) jumps = jumps_;
    const bool given_up =
        jumps != jumps_ && urgency_of(run.pieces[0]) > settings_.layer_patience_seconds;
    if (done < run.bytes && (stopping_ || given_up)) {
      bytes.clear();
      return {};
    }
  }
  return {};
}

void SegmentStore::put(const Run& run, std::span<const std::uint8_t> bytes) {
  for (const Piece& piece : run.pieces) {
    const auto own = bytes.subspan(static_cast<std::size_t>(piece_offset(piece) - run.offset),
                                   static_cast<std::size_t>(piece_bytes(piece)));
    source_.put(piece_offset(piece), {own.begin(), own.end()});
  }
}

// What did not come: because of an error, or given up for something more urgent.
void SegmentStore::give_back(const Run& run, const Status& status) {
  for (const Piece& piece : run.pieces) {
    memory_ -= memory_of(piece);
    state(piece).at = At::kAway;
    if (!status.ok() && !stopping_) {
      lose(piece, settings_.retry_seconds, PlayerEvent::Kind::kLost, status);
    }
  }
}

void SegmentStore::lose(const Piece& piece, double seconds, PlayerEvent::Kind kind,
                        const Status& status) {
  state(piece) = {At::kLost, clock_seconds() + seconds};
  PlayerEvent event;
  event.kind = kind;
  event.seconds = reader_->metadata().time_base.seconds(motion_.ticks);
  event.offset = piece_offset(piece);
  event.message = status.message();
  events_.push_back(std::move(event));
}

// The most urgent segment that can be decoded better than it is.
std::optional<std::uint32_t> SegmentStore::next_decode() const {
  std::optional<std::uint32_t> best;
  double least = kForEver;
  for (std::uint32_t s = 0; s < entries_.size(); ++s) {
    const Entry& entry = entries_[s];
    if (entry.decoding || entry.base.at != At::kHere) continue;
    const bool better = entry.held == nullptr;
    if (!better && (entry.with_harmonics || entry.harmonics.at != At::kHere)) continue;
    if (const double u = urgency_of({s, !better}); !best || u < least) {
      least = u;
      best = s;
    }
  }
  return best;
}

Status SegmentStore::decode(std::uint32_t segment, bool with_harmonics,
                            std::shared_ptr<const HeldSegment>& held) const {
  try {
    STGS_ASSIGN(Gaussians4D set, reader_->decode(segment, with_harmonics));
    held = std::make_shared<const HeldSegment>(std::move(set));
    return {};
  } catch (const std::exception& e) {
    return runtime_error("{}: cannot hold segment {}: {}", source_.name(), segment, e.what());
  }
}

void SegmentStore::decode_segments() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    const std::optional<std::uint32_t> segment = next_decode();
    if (!segment) {
      to_decode_.wait(lock);
      continue;
    }
    Entry& entry = entries_[*segment];
    const bool harmonics = entry.harmonics.at == At::kHere;
    entry.decoding = true;
    lock.unlock();
    std::shared_ptr<const HeldSegment> held;
    const Status status = decode(*segment, harmonics, held);
    lock.lock();
    entry.decoding = false;
    if (held != nullptr) {
      entry.held = std::move(held);
      entry.with_harmonics = harmonics;
      continue;
    }
    // Without its harmonics it may be sound; without its base there is nothing.
    const Piece bad{*segment, harmonics && piece_bytes({*segment, true}) > 0};
    memory_ -= memory_of(bad);
    source_.drop(piece_offset(bad));
    lose(bad, kForEver, PlayerEvent::Kind::kDamaged, status);
    losses_.push_back({bad.segment, bad.harmonics, status});
  }
}

}  // namespace stgs::player
