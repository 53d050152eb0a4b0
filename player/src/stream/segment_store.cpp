// SPDX-License-Identifier: Apache-2.0
#include "stream/segment_store.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <system_error>
#include <utility>

#include "stgs/format/parallel.h"
#include "stream/clock_seconds.h"
#include "stream/no_memory.h"

namespace stgs::player {
namespace {

constexpr double kForEver = std::numeric_limits<double>::infinity();

std::uint64_t offset_of(const SegmentInfo& segment, bool harmonics) {
  return harmonics ? segment.sh_offset : segment.offset;
}
std::uint64_t bytes_of(const SegmentInfo& segment, bool harmonics) {
  return harmonics ? segment.sh_bytes : segment.bytes;
}

// Of the segments from `first` on, by offset.
std::vector<Piece> pieces_from(const std::vector<SegmentInfo>& segments, std::size_t first) {
  std::vector<Piece> out;
  for (std::size_t s = first; s < segments.size(); ++s) {
    for (const bool harmonics : {false, true}) {
      if (bytes_of(segments[s], harmonics) == 0) continue;
      out.push_back({static_cast<std::uint32_t>(s), harmonics});
    }
  }
  const auto offset = [&](const Piece& p) { return offset_of(segments[p.segment], p.harmonics); };
  std::sort(out.begin(), out.end(),
            [&](const Piece& a, const Piece& b) { return offset(a) < offset(b); });
  return out;
}

// How many segments are decoded at once. Each is decoded on all cores already: this is for what one
// core does of it alone.
int decoders_for(TaskRunner* runner) {
  constexpr int kMost = 8;
  const ScopedTaskRunner use(runner);
  const int threads = std::max(concurrency(), 1);
  return std::clamp(threads / 2, std::min(threads, 2), kMost);
}

}  // namespace

SegmentStore::SegmentStore(std::shared_ptr<const SceneReader> reader,
                           std::shared_ptr<RangeSource> source, const PlayerSettings& settings,
                           std::function<void(bool)> on_changed)
    : source_(std::move(source)),
      settings_(settings),
      on_changed_(std::move(on_changed)),
      reader_(std::move(reader)) {
  take_reader(reader_);
  motion_.duration = reader_->metadata().frames;
  start_threads();
}

SegmentStore::~SegmentStore() {
  stop();
  for (std::thread& thread : threads_) thread.join();
}

// Whether the reader's segments begin with those that are listed, and the rest lies behind them.
bool SegmentStore::goes_on(const SceneReader& reader) const {
  const std::vector<SegmentInfo>&before = reader_->segments(), &now = reader.segments();
  const auto same = [](const SegmentInfo& a, const SegmentInfo& b) {
    return a.offset == b.offset && a.bytes == b.bytes && a.primitives == b.primitives &&
           a.sh_offset == b.sh_offset && a.sh_bytes == b.sh_bytes;
  };
  return now.size() >= before.size() &&
         std::equal(before.begin(), before.end(), now.begin(), same) &&
         std::all_of(now.begin() + static_cast<std::ptrdiff_t>(before.size()), now.end(),
                     [&](const SegmentInfo& s) { return s.offset >= reader_->file_bytes(); });
}

// Lists the segments of a reader that are not listed yet; they follow the others in the file. All
// that can throw comes before all that changes.
void SegmentStore::take_reader(std::shared_ptr<const SceneReader> reader) {
  const std::vector<SegmentInfo>& segments = reader->segments();
  // A fragment of the index that was damaged leaves out what a later one may list again.
  const bool anew = !goes_on(*reader);
  const std::vector<Piece> more = pieces_from(segments, anew ? 0 : entries_.size());
  reserve_for(entries_, segments.size());
  reserve_for(in_file_, (anew ? 0 : in_file_.size()) + more.size());
  reserve_for(places_, 2 * segments.size());
  if (anew) forget_segments();
  reader_ = std::move(reader);
  const std::size_t first = entries_.size();
  entries_.resize(segments.size());
  for (std::size_t s = first; s < segments.size(); ++s) {
    tiers_ = std::max(tiers_, segments[s].tier + 1);
    if (!segments[s].available) entries_[s].base = {At::kLost, kForEver};
    if (!segments[s].sh_available) entries_[s].harmonics = {At::kLost, kForEver};
    if (segments[s].sh_bytes == 0) entries_[s].harmonics.at = At::kHere;
  }
  places_.resize(2 * segments.size());
  for (const Piece& piece : more) {
    places_[2 * std::size_t{piece.segment} + (piece.harmonics ? 1 : 0)] = in_file_.size();
    in_file_.push_back(piece);
  }
}

// What is under way of them goes when it has come.
void SegmentStore::forget_segments() {
  for (const Piece& piece : in_file_) {
    if (state(piece).at == At::kHere) source_->drop(piece_offset(piece));
  }
  source_->forget_recent();
  entries_.clear();
  in_file_.clear();
  places_.clear();
  losses_.clear();
  memory_ = stored_primitives_ = 0;
  full_from_ = kForEver;
  ++generation_;
}

void SegmentStore::grow(std::shared_ptr<const SceneReader> reader) {
  {
    const std::lock_guard lock(mutex_);
    take_reader(std::move(reader));
  }
  to_fetch_.notify_all();
}

SegmentStore::Known SegmentStore::known() const {
  const std::lock_guard lock(mutex_);
  return {reader_, generation_};
}

int SegmentStore::tiers() const {
  const std::lock_guard lock(mutex_);
  return tiers_;
}

void SegmentStore::start_threads() {
  try {
    decoders_ = decoders_for(settings_.task_runner);
    for (int k = 0; k < settings_.max_reads_in_flight; ++k) run_thread(&SegmentStore::fetch_pieces);
    run_thread(&SegmentStore::decode_segments);
    start_more_decoders();
  } catch (...) {
    stop();
    for (std::thread& thread : threads_) thread.join();
    throw;
  }
}

// Those that there are threads for: one is enough.
void SegmentStore::start_more_decoders() {
  try {
    for (int k = 1; k < decoders_; ++k) run_thread(&SegmentStore::decode_segments);
  } catch (const std::system_error&) {
  }
}

void SegmentStore::run_thread(void (SegmentStore::*work)()) {
  threads_.emplace_back([this, work] { (this->*work)(); });
}

void SegmentStore::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  to_fetch_.notify_all();
  to_decode_.notify_all();
}

void SegmentStore::move(const Playhead& motion, bool jumped) {
  {
    const std::lock_guard lock(mutex_);
    is_placed_ = true;
    motion_ = motion;
    jumps_ += jumped ? 1 : 0;
    if (jumped) full_from_ = kForEver;
  }
  to_fetch_.notify_all();
  if (jumped) to_decode_.notify_all();
}

Playhead SegmentStore::motion() const {
  const std::lock_guard lock(mutex_);
  return motion_;
}

std::shared_ptr<const ResidentSegment> SegmentStore::held(std::uint32_t segment,
                                                          std::uint64_t generation) const {
  const std::lock_guard lock(mutex_);
  return generation == generation_ ? entries_[segment].held : nullptr;
}

bool SegmentStore::base_settled(std::uint32_t segment) const {
  // A base that was lost and comes again is not waited for.
  const Entry& entry = entries_[segment];
  return entry.held != nullptr || entry.base.at == At::kLost || entry.base.patience > 0 ||
         !reader_->segments()[segment].is_shown();
}

bool SegmentStore::harmonics_settled(std::uint32_t segment) const {
  const Entry& entry = entries_[segment];
  return entry.with_harmonics || entry.harmonics.at == At::kLost || entry.harmonics.patience > 0 ||
         (entry.held == nullptr && base_settled(segment));
}

bool SegmentStore::has_no_room(const Piece& piece) const {
  return state(piece).at == At::kAway && urgency_of(piece) >= full_from_;
}

bool SegmentStore::ready(double ticks) const {
  const std::lock_guard lock(mutex_);
  const std::vector<std::uint32_t> alive = reader_->segments_between(ticks, ticks);
  return std::all_of(alive.begin(), alive.end(), [this](std::uint32_t s) {
    return reader_->segments()[s].tier > 0 || base_settled(s);
  });
}

std::vector<TickRange> SegmentStore::ready_ranges() const {
  std::vector<TickRange> gaps;
  double end = 0;
  {
    const std::lock_guard lock(mutex_);
    end = reader_->metadata().frames;
    for (std::uint32_t s = 0; s < entries_.size(); ++s) {
      const SegmentInfo& segment = reader_->segments()[s];
      if (segment.tier == 0 && !base_settled(s))
        gaps.push_back({segment.begin_ticks, segment.end_ticks});
    }
  }
  std::sort(gaps.begin(), gaps.end(),
            [](const TickRange& a, const TickRange& b) { return a.begin < b.begin; });
  std::vector<TickRange> ranges;
  double at = 0;
  for (const TickRange& gap : gaps) {
    if (gap.begin > at) ranges.push_back({at, std::min(gap.begin, end)});
    at = std::max(at, gap.end);
  }
  if (at < end) ranges.push_back({at, end});
  return ranges;
}

int SegmentStore::layers(double ticks) const {
  const std::lock_guard lock(mutex_);
  const std::vector<std::uint32_t> alive = reader_->segments_between(ticks, ticks);
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

bool SegmentStore::settled(double ticks) const {
  const std::lock_guard lock(mutex_);
  const std::vector<std::uint32_t> alive = reader_->segments_between(ticks, ticks);
  return std::all_of(alive.begin(), alive.end(), [this](std::uint32_t s) {
    if (!base_settled(s)) return has_no_room({s, false});
    return harmonics_settled(s) || has_no_room({s, true});
  });
}

StreamStatistics SegmentStore::statistics() const {
  const std::lock_guard lock(mutex_);
  StreamStatistics out;
  out.bytes_per_second = throughput_.bytes_per_second();
  out.fetched_bytes = fetched_bytes_;
  out.memory_bytes = memory_;
  out.stored_primitives = stored_primitives_;
  return out;
}

std::vector<PlayerEvent> SegmentStore::take_events() {
  const std::lock_guard lock(mutex_);
  return events_.take();
}

std::vector<SegmentDamage> SegmentStore::segment_damage() const {
  const std::lock_guard lock(mutex_);
  return losses_;
}

void SegmentStore::tell(PlayerEvent event) noexcept {
  const std::lock_guard lock(mutex_);
  add_event(std::move(event));
}

void SegmentStore::add_event(PlayerEvent event) noexcept {
  event.seconds = reader_->metadata().time_base.seconds(motion_.ticks);
  events_.add(std::move(event));
}

std::uint64_t SegmentStore::piece_bytes(const Piece& piece) const {
  return bytes_of(reader_->segments()[piece.segment], piece.harmonics);
}

std::uint64_t SegmentStore::piece_offset(const Piece& piece) const {
  return offset_of(reader_->segments()[piece.segment], piece.harmonics);
}

std::uint64_t SegmentStore::memory_of(const Piece& piece) const {
  const SegmentInfo& segment = reader_->segments()[piece.segment];
  const std::uint64_t decoded =
      piece.harmonics ? 0 : decoded_segment_bytes(segment.primitives, reader_->sh_degree());
  return piece_bytes(piece) + decoded;
}

Need SegmentStore::need_for(const Piece& piece) const {
  const SegmentInfo& segment = reader_->segments()[piece.segment];
  return need_of(segment.begin_ticks, segment.end_ticks, motion_);
}

double SegmentStore::urgency_of(const Piece& piece) const {
  return deadline(need_for(piece),
                  layer_of(reader_->segments()[piece.segment], piece.harmonics, tiers_),
                  settings_.layer_lead_seconds);
}

void SegmentStore::count(const Piece& piece, std::uint64_t memory) {
  PieceState& own = state(piece);
  memory_ += memory - own.memory;
  own.memory = memory;
}

void SegmentStore::hold(std::uint32_t segment, std::shared_ptr<const ResidentSegment> held) {
  std::shared_ptr<const ResidentSegment>& own = entries_[segment].held;
  if (own != nullptr) stored_primitives_ -= own->set.size();
  own = std::move(held);
  if (own != nullptr) stored_primitives_ += own->set.size();
}

// What a piece leaves when it is not here any more.
void SegmentStore::release(const Piece& piece, At at) {
  source_->drop(piece_offset(piece));
  count(piece, 0);
  state(piece).at = at;
}

// Whether a segment has something to drop, and nobody is at it.
bool SegmentStore::can_drop(std::uint32_t segment) const {
  const Entry& entry = entries_[segment];
  return entry.base.memory + entry.harmonics.memory > 0 && !entry.decoding &&
         entry.base.at != At::kComing && entry.harmonics.at != At::kComing;
}

// Drops what is needed later than `urgency`, the latest first, until `bytes` more fit; nothing
// where they cannot.
bool SegmentStore::make_room(std::uint64_t bytes, double urgency) {
  if (memory_ + bytes <= settings_.memory_budget) return true;
  std::vector<std::pair<double, std::uint32_t>> later;
  std::uint64_t room = settings_.memory_budget - std::min(memory_, settings_.memory_budget);
  for (std::uint32_t s = 0; s < entries_.size(); ++s) {
    if (!can_drop(s)) continue;
    const double own = urgency_of({s, false});
    if (own <= urgency) continue;
    later.emplace_back(own, s);
    room += entries_[s].base.memory + entries_[s].harmonics.memory;
  }
  if (room < bytes) return false;
  std::sort(later.rbegin(), later.rend());
  for (std::size_t k = 0; memory_ + bytes > settings_.memory_budget; ++k) drop(later[k].second);
  return true;
}

void SegmentStore::drop(std::uint32_t segment) {
  Entry& entry = entries_[segment];
  for (const bool harmonics : {false, true}) {
    const Piece piece{segment, harmonics};
    if (piece_bytes(piece) > 0 && state(piece).at == At::kHere) release(piece, At::kAway);
  }
  hold(segment, nullptr);
  entry.with_harmonics = false;
}

void SegmentStore::drop_harmonics(std::uint32_t segment) noexcept {
  const Piece piece{segment, true};
  if (piece_bytes(piece) > 0 && state(piece).at == At::kHere) release(piece, At::kAway);
}

// A piece that could not be had: tried again, each time after twice as long, or never.
void SegmentStore::lose(const Piece& piece, bool for_ever, PlayerEvent::Kind kind,
                        const Status& status) noexcept {
  constexpr double kLongest = 10;  // seconds
  release(piece, At::kLost);
  PieceState& own = state(piece);
  own.patience = own.patience > 0
                     ? std::min(2 * own.patience, std::max(kLongest, settings_.retry_seconds))
                     : std::max(settings_.retry_seconds, 1e-3);
  own.retry = for_ever ? kForEver : clock_seconds() + own.patience;
  if (!piece.harmonics && for_ever) drop_harmonics(piece.segment);  // nothing without their base
  add_event(event_of(kind, piece_offset(piece), status.code(), status.message()));
}

}  // namespace stgs::player
