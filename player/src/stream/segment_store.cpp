// SPDX-License-Identifier: Apache-2.0
#include "stream/segment_store.h"

#include <algorithm>
#include <utility>

#include "stream/no_memory.h"

namespace stgs::player {

SegmentStore::SegmentStore(std::shared_ptr<const SceneReader> reader,
                           std::shared_ptr<RangeSource> source, const PlayerSettings& settings,
                           std::shared_ptr<Budget> budget,
                           std::unique_ptr<AsyncByteSource> transport,
                           std::unique_ptr<DecodeExecutor> executor,
                           std::function<void(bool)> on_replaced)
    : source_(std::move(source)),
      settings_(settings),
      budget_(std::move(budget)),
      on_replaced_(std::move(on_replaced)),
      index_charge_(budget_->charge(Budget::Pool::kIndex, 0)),
      index_(settings.segment_overhead),
      deadlines_(index_, settings.layer_lead_seconds),
      residency_(index_, deadlines_, *budget_, settings.retry_seconds,
                 [this](std::uint64_t offset) { source_->erase(offset); }),
      // Playback needs at least what it requires to resume.
      fetches_(
          index_, deadlines_, residency_,
          {std::max(settings.prefetch_seconds, settings.resume_seconds), settings.resume_seconds}),
      monitor_(settings.retry_seconds),
      transport_(std::move(transport)),
      executor_(std::move(executor)),
      decodes_(index_, deadlines_, residency_, *budget_, *executor_) {
  adopt(std::move(reader));
  deadlines_.set_duration(index_.duration());
  executor_->start([this](DecodeJob job, DecodeResult result) {
    {
      const std::lock_guard lock(done_mutex_);
      decodes_done_.push_back({std::move(job), std::move(result)});
    }
    wake(WakeReason::kEnded);
  });
  // So that completions do not allocate.
  const auto jobs = static_cast<std::size_t>(executor_->max_jobs());
  const auto reads = static_cast<std::size_t>(settings_.max_reads_in_flight);
  for (auto* list : {&decodes_done_, &finished_}) list->reserve(jobs);
  for (auto* list : {&reads_done_, &arrived_}) list->reserve(reads);
  transport_->start([this](AsyncByteSource::Done done) {
    {
      const std::lock_guard lock(done_mutex_);
      reads_done_.push_back(std::move(done));
    }
    wake(WakeReason::kEnded);
  });
}

SegmentStore::~SegmentStore() {
  stop();
}

void SegmentStore::stop() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  transport_->stop();
  executor_->stop();
}

// Everything that can throw comes before any change.
void SegmentStore::adopt(std::shared_ptr<const SceneReader> reader) {
  SegmentIndex::Update update = index_.prepare(std::move(reader));
  residency_.reserve(update.reader->segments().size());
  decodes_.reserve(update.reader->segments().size());
  if (update.renumbered) {
    residency_.clear();
    source_->forget_recent();
  }
  index_charge_.resize(update.reader->memory_bytes());
  const int needed_tiers = index_.needed_tiers();
  const std::vector<std::uint32_t> ended = std::move(update.ended);
  index_.adopt(std::move(update));
  residency_.extend();
  residency_.add_ends(ended);
  if (index_.needed_tiers() != needed_tiers) residency_.apply_needs();
}

void SegmentStore::grow(std::shared_ptr<const SceneReader> reader) {
  {
    const std::lock_guard lock(mutex_);
    adopt(std::move(reader));
  }
  wake(WakeReason::kChanged);
}

FileSnapshot SegmentStore::snapshot() const {
  const std::lock_guard lock(mutex_);
  return index_.snapshot();
}

int SegmentStore::tiers() const {
  const std::lock_guard lock(mutex_);
  return index_.tiers();
}

void SegmentStore::limit_primitives(std::uint64_t max_primitives) {
  {
    const std::lock_guard lock(mutex_);
    index_.limit_primitives(max_primitives);
    residency_.apply_needs();
  }
  wake(WakeReason::kChanged);
}

std::vector<std::uint64_t> SegmentStore::tier_peaks() const {
  const std::lock_guard lock(mutex_);
  return index_.tier_peaks();
}

std::optional<TickRange> SegmentStore::unknown_times() const {
  const std::lock_guard lock(mutex_);
  if (!deadlines_.has_playhead()) return {};
  return index_.unknown_times(deadlines_.playhead(), settings_.prefetch_seconds);
}

void SegmentStore::set_playhead(const Playhead& playhead, bool jumped) {
  bool is_unknown = false;
  {
    const std::lock_guard lock(mutex_);
    deadlines_.set_playhead(playhead, jumped);
    if (jumped) residency_.forget_full();
    is_unknown = index_.unknown_times(playhead, settings_.prefetch_seconds).has_value();
  }
  if (is_unknown && on_unknown_) on_unknown_();
  wake(jumped ? WakeReason::kJump : WakeReason::kChanged);
}

Playhead SegmentStore::playhead() const {
  const std::lock_guard lock(mutex_);
  return deadlines_.playhead();
}

DecodedSegment SegmentStore::resident(std::uint32_t segment, std::uint64_t generation) const {
  const std::lock_guard lock(mutex_);
  if (generation != index_.generation() || !index_.is_needed(segment)) return nullptr;
  return residency_.resident(segment);
}

ClipExtent SegmentStore::extent() const {
  const std::lock_guard lock(mutex_);
  return extent_of(index_.reader());
}

bool SegmentStore::ready(double ticks) const {
  const std::lock_guard lock(mutex_);
  return residency_.ready(ticks);
}

std::vector<TickRange> SegmentStore::ready_ranges() const {
  const std::lock_guard lock(mutex_);
  return residency_.ready_ranges();
}

int SegmentStore::layers(double ticks) const {
  const std::lock_guard lock(mutex_);
  return residency_.layers(ticks);
}

bool SegmentStore::is_complete(double ticks) const {
  const std::lock_guard lock(mutex_);
  return residency_.is_complete(ticks);
}

StreamStatistics SegmentStore::statistics() const {
  const std::lock_guard lock(mutex_);
  StreamStatistics out;
  out.bytes_per_second = fetches_.bytes_per_second();
  out.fetched_bytes = fetches_.fetched_bytes();
  out.memory_bytes = budget_->usage(Budget::Pool::kSegments).used;
  out.stored_primitives = residency_.stored_primitives();
  return out;
}

std::vector<SegmentDamage> SegmentStore::segment_damage() const {
  const std::lock_guard lock(mutex_);
  return residency_.damage();
}

std::vector<PlayerEvent> SegmentStore::take_events() {
  const std::lock_guard lock(mutex_);
  return events_.take();
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
  event.seconds = index_.reader().metadata().time_base.seconds(deadlines_.playhead().ticks);
  events_.add(std::move(event));
}

}  // namespace stgs::player
