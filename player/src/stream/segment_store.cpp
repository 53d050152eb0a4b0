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

constexpr double kNever = std::numeric_limits<double>::infinity();

// Returns the number of segments to decode at once. Each one already uses all cores; several
// overlap the parts that run on a single core.
int max_decodes_for(TaskRunner* runner) {
  constexpr int kMaxDecodes = 8;
  const ScopedTaskRunner use(runner);
  const int threads = std::max(concurrency(), 1);
  return std::clamp(threads / 2, std::min(threads, 2), kMaxDecodes);
}

}  // namespace

SegmentStore::SegmentStore(std::shared_ptr<const SceneReader> reader,
                           std::shared_ptr<RangeSource> source, const PlayerSettings& settings,
                           std::function<void(bool)> on_replaced)
    : source_(std::move(source)),
      settings_(settings),
      on_replaced_(std::move(on_replaced)),
      reader_(std::move(reader)) {
  adopt_reader(reader_);
  playhead_.duration = reader_->metadata().frames;
  start_threads();
}

SegmentStore::~SegmentStore() {
  stop();
  for (std::thread& thread : threads_) thread.join();
}

void SegmentStore::start_threads() {
  try {
    max_decodes_ = max_decodes_for(settings_.task_runner);
    for (int k = 0; k < settings_.max_reads_in_flight; ++k)
      start_thread(&SegmentStore::run_fetcher);
    start_thread(&SegmentStore::run_decoder);
    start_more_decoders();
  } catch (...) {
    stop();
    for (std::thread& thread : threads_) thread.join();
    throw;
  }
}

// Starts as many further decoders as the system has threads for; one is sufficient.
void SegmentStore::start_more_decoders() {
  try {
    for (int k = 1; k < max_decodes_; ++k) start_thread(&SegmentStore::run_decoder);
  } catch (const std::system_error&) {
  }
}

void SegmentStore::start_thread(void (SegmentStore::*work)()) {
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

void SegmentStore::set_playhead(const Playhead& playhead, bool jumped) {
  {
    const std::lock_guard lock(mutex_);
    has_playhead_ = true;
    playhead_ = playhead;
    jumps_ += jumped ? 1 : 0;
    if (jumped) full_from_ = kNever;
  }
  to_fetch_.notify_all();
  if (jumped) to_decode_.notify_all();
}

Playhead SegmentStore::playhead() const {
  const std::lock_guard lock(mutex_);
  return playhead_;
}

std::shared_ptr<const ResidentSegment> SegmentStore::resident(std::uint32_t segment,
                                                              std::uint64_t generation) const {
  const std::lock_guard lock(mutex_);
  return generation == generation_ ? entries_[segment].resident : nullptr;
}

bool SegmentStore::is_base_final(std::uint32_t segment) const {
  // Playback does not wait for a base that failed before, even while it is retried.
  const Entry& entry = entries_[segment];
  return entry.resident != nullptr || entry.base.state == LoadState::kFailed ||
         entry.base.backoff > 0 || !reader_->segments()[segment].is_shown();
}

bool SegmentStore::is_sh_final(std::uint32_t segment) const {
  const Entry& entry = entries_[segment];
  return entry.has_sh || entry.sh.state == LoadState::kFailed || entry.sh.backoff > 0 ||
         (entry.resident == nullptr && is_base_final(segment));
}

bool SegmentStore::does_not_fit(const SegmentLayer& layer) const {
  return state_of(layer).state == LoadState::kMissing && deadline_of(layer) >= full_from_;
}

ClipExtent SegmentStore::extent() const {
  const std::lock_guard lock(mutex_);
  return extent_of(*reader_);
}

bool SegmentStore::ready(double ticks) const {
  const std::lock_guard lock(mutex_);
  const std::vector<std::uint32_t> active = reader_->segments_between(ticks, ticks);
  return std::all_of(active.begin(), active.end(), [this](std::uint32_t s) {
    return reader_->segments()[s].tier > 0 || is_base_final(s);
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
      if (segment.tier == 0 && !is_base_final(s))
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
  const std::vector<std::uint32_t> active = reader_->segments_between(ticks, ticks);
  int layers = 2 * tiers_;
  for (std::uint32_t s : active) {
    const SegmentInfo& segment = reader_->segments()[s];
    const Entry& entry = entries_[s];
    if (entry.resident == nullptr) {
      layers = std::min(layers, layer_of(segment, false, tiers_));
    } else if (!entry.has_sh) {
      layers = std::min(layers, layer_of(segment, true, tiers_));
    }
  }
  return layers;
}

bool SegmentStore::is_complete(double ticks) const {
  const std::lock_guard lock(mutex_);
  const std::vector<std::uint32_t> active = reader_->segments_between(ticks, ticks);
  return std::all_of(active.begin(), active.end(), [this](std::uint32_t s) {
    if (!is_base_final(s)) return does_not_fit({s, false});
    return is_sh_final(s) || does_not_fit({s, true});
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
  return damage_;
}

void SegmentStore::push_event(PlayerEvent event) noexcept {
  const std::lock_guard lock(mutex_);
  append_event(std::move(event));
}

void SegmentStore::push_stamped_event(PlayerEvent event) noexcept {
  const std::lock_guard lock(mutex_);
  events_.add(std::move(event));
}

void SegmentStore::append_event(PlayerEvent event) noexcept {
  event.seconds = reader_->metadata().time_base.seconds(playhead_.ticks);
  events_.add(std::move(event));
}

std::uint64_t SegmentStore::memory_of(const SegmentLayer& layer) const {
  const SegmentInfo& segment = reader_->segments()[layer.segment];
  const std::uint64_t decoded =
      layer.sh ? 0 : decoded_segment_bytes(segment.primitives, reader_->sh_degree());
  return stored_bytes(layer) + decoded;
}

Need SegmentStore::need_for(const SegmentLayer& layer) const {
  const SegmentInfo& segment = reader_->segments()[layer.segment];
  return need_of(segment.begin_ticks, segment.end_ticks, playhead_);
}

double SegmentStore::deadline_of(const SegmentLayer& layer) const {
  return deadline(need_for(layer), layer_of(reader_->segments()[layer.segment], layer.sh, tiers_),
                  settings_.layer_lead_seconds);
}

// Sets the memory charged for a layer.
void SegmentStore::set_memory(const SegmentLayer& layer, std::uint64_t bytes) {
  LayerState& own = state_of(layer);
  memory_ += bytes - own.memory;
  own.memory = bytes;
}

void SegmentStore::set_resident(std::uint32_t segment,
                                std::shared_ptr<const ResidentSegment> resident) {
  std::shared_ptr<const ResidentSegment>& own = entries_[segment].resident;
  if (own != nullptr) stored_primitives_ -= own->set.size();
  own = std::move(resident);
  if (own != nullptr) stored_primitives_ += own->set.size();
}

// Releases the bytes and memory of a layer that is no longer resident or in flight.
void SegmentStore::release(const SegmentLayer& layer, LoadState state) {
  source_->erase(file_offset(layer));
  set_memory(layer, 0);
  state_of(layer).state = state;
}

// Returns whether a segment holds memory and is neither being decoded nor fetched.
bool SegmentStore::is_evictable(std::uint32_t segment) const {
  const Entry& entry = entries_[segment];
  return entry.base.memory + entry.sh.memory > 0 && !entry.decoding &&
         entry.base.state != LoadState::kInFlight && entry.sh.state != LoadState::kInFlight;
}

// Evicts segments with a later deadline, latest first, until `bytes` more fit the budget. Returns
// false and evicts nothing if that is impossible.
bool SegmentStore::evict_for(std::uint64_t bytes, double deadline) {
  if (memory_ + bytes <= settings_.memory_budget) return true;
  std::vector<std::pair<double, std::uint32_t>> later;
  std::uint64_t available = settings_.memory_budget - std::min(memory_, settings_.memory_budget);
  for (std::uint32_t s = 0; s < entries_.size(); ++s) {
    if (!is_evictable(s)) continue;
    const double own = deadline_of({s, false});
    if (own <= deadline) continue;
    later.emplace_back(own, s);
    available += entries_[s].base.memory + entries_[s].sh.memory;
  }
  if (available < bytes) return false;
  std::sort(later.rbegin(), later.rend());
  for (std::size_t k = 0; memory_ + bytes > settings_.memory_budget; ++k) evict(later[k].second);
  return true;
}

void SegmentStore::evict(std::uint32_t segment) {
  Entry& entry = entries_[segment];
  for (const bool sh : {false, true}) {
    const SegmentLayer layer{segment, sh};
    if (stored_bytes(layer) > 0 && state_of(layer).state == LoadState::kResident)
      release(layer, LoadState::kMissing);
  }
  set_resident(segment, nullptr);
  entry.has_sh = false;
}

void SegmentStore::evict_sh(std::uint32_t segment) noexcept {
  const SegmentLayer layer{segment, true};
  if (stored_bytes(layer) > 0 && state_of(layer).state == LoadState::kResident)
    release(layer, LoadState::kMissing);
}

// Marks a layer as failed. It is retried with exponential backoff, unless it failed permanently.
void SegmentStore::mark_failed(const SegmentLayer& layer, bool permanently, PlayerEvent::Kind kind,
                               const Status& status) noexcept {
  constexpr double kMaxBackoff = 10;  // seconds
  release(layer, LoadState::kFailed);
  LayerState& own = state_of(layer);
  own.backoff = own.backoff > 0
                    ? std::min(2 * own.backoff, std::max(kMaxBackoff, settings_.retry_seconds))
                    : std::max(settings_.retry_seconds, 1e-3);
  own.retry_at = permanently ? kNever : clock_seconds() + own.backoff;
  if (!layer.sh && permanently) evict_sh(layer.segment);  // useless without its base
  append_event(event_of(kind, file_offset(layer), status.code(), status.message()));
}

}  // namespace stgs::player
