// SPDX-License-Identifier: Apache-2.0
// SegmentStore: schedules and runs fetches.
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

constexpr double kNever = std::numeric_limits<double>::infinity();
// Bytes of a request, unless its first layer is larger; bytes of a gap between its layers.
constexpr std::uint64_t kMaxRequest = 512 << 10, kMaxGap = 4 << 10;
// Duration up to which a request is extended by layers of any deadline.
constexpr double kMaxExtraSeconds = 0.1;
// Duration and bytes of a single read, which a seek has to wait for.
constexpr double kReadSeconds = 0.25;
constexpr double kMaxReadSeconds = 2 * kReadSeconds;  // after this, a seek interrupts a read
constexpr double kMinRead = 64 << 10, kMaxRead = 1 << 20;
// Time for which a layer that the viewer waits for has the link to itself, seconds.
constexpr double kExclusiveSeconds = 1;

}  // namespace

// Returns whether a layer is missing and needed within the prefetch horizon.
bool SegmentStore::is_fetchable(const SegmentLayer& layer, double now) const {
  if (!reader_->segments()[layer.segment].is_shown()) return false;
  const Entry& entry = entries_[layer.segment];
  const LayerState& own = state_of(layer);
  if (own.state != LoadState::kMissing && !(own.state == LoadState::kFailed && now >= own.retry_at))
    return false;
  if (layer.sh && entry.base.state != LoadState::kResident &&
      entry.base.state != LoadState::kInFlight)
    return false;
  return need_for(layer).from <= prefetch_horizon();
}

// Returns whether a layer can arrive before the last time that shows it, at the current throughput.
// Layer 0 is always attempted.
bool SegmentStore::arrives_in_time(const SegmentLayer& layer) const {
  const double speed = throughput_.bytes_per_second();
  if (layer_of(reader_->segments()[layer.segment], layer.sh, tiers_) == 0 || speed == 0) {
    return true;
  }
  return static_cast<double>(stored_bytes(layer)) / speed <= need_for(layer).until;
}

// Returns whether a request that the viewer waits for has recently begun.
bool SegmentStore::is_viewer_waiting(double now) const {
  return std::any_of(requests_.begin(), requests_.end(), [&](const FetchRequest& request) {
    return request.generation == generation_ && deadline_of(request.layers[0].layer) <= 0 &&
           now < request.started_at + kExclusiveSeconds;
  });
}

// Returns the layers that playback reaches within the prefetch horizon, and some more, by their
// index in file order.
std::vector<std::size_t> SegmentStore::upcoming_layers() const {
  constexpr double kAround = 1;  // ticks; is_fetchable() checks each layer exactly
  const double speed = std::abs(playhead_.ticks_per_second);
  const double ahead = prefetch_horizon() * speed, at = playhead_.ticks, end = playhead_.duration;
  const bool back = playhead_.ticks_per_second < 0;
  std::vector<std::uint32_t> near =
      back ? reader_->segments_between(at - ahead - kAround, at + kAround)
           : reader_->segments_between(at - kAround, at + ahead + kAround);
  if (const double wrapped = back ? end + at - ahead : at + ahead - end; playhead_.loop) {
    const auto more = back ? reader_->segments_between(std::max(wrapped, at) - kAround, end)
                           : reader_->segments_between(0, std::min(wrapped, at) + kAround);
    near.insert(near.end(), more.begin(), more.end());
  }
  std::vector<std::size_t> out;
  for (const std::uint32_t segment : near) {
    for (const bool sh : {false, true}) {
      if (stored_bytes({segment, sh}) > 0) out.push_back(file_index({segment, sh}));
    }
  }
  // In file order, so that ties go to the first. Removes those that are near in both directions.
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

// Returns the most urgent layer. While the viewer waits for one, no other layer competes for
// bandwidth. Layers that would arrive too late are attempted only if nothing is in flight, in case
// the link has become faster.
std::optional<SegmentLayer> SegmentStore::next_layer(double now) const {
  const bool only_urgent = is_viewer_waiting(now);
  std::optional<SegmentLayer> best, late;
  double best_deadline = kNever, late_deadline = kNever;
  for (const std::size_t index : upcoming_layers()) {
    const SegmentLayer& layer = file_order_[index];
    if (!is_fetchable(layer, now)) continue;
    const double deadline = deadline_of(layer);
    if (only_urgent && deadline > 0) continue;
    if (deadline < best_deadline && arrives_in_time(layer)) {
      best_deadline = deadline;
      best = layer;
    } else if (deadline < late_deadline) {
      late_deadline = deadline;
      late = layer;
    }
  }
  return best || !requests_.empty() ? best : late;
}

// Charges the budget for a layer and marks it as in flight. Returns false if it does not fit.
bool SegmentStore::reserve(const SegmentLayer& layer, double deadline) {
  if (!evict_for(memory_of(layer), deadline)) return false;
  if (deadline >= full_from_) full_from_ = kNever;
  set_memory(layer, memory_of(layer));
  state_of(layer).state = LoadState::kInFlight;
  return true;
}

// Returns whether decoding is about to free memory.
bool SegmentStore::is_decoding() const {
  return decoding_.segments > 0 || next_decode();
}

// Appends the next request to `out`. Returns false if there is none. If this throws, `out` holds
// the requests to cancel.
bool SegmentStore::next_request(double now, FetchRequests& out) {
  if (!has_playhead_) return false;
  const std::optional<SegmentLayer> first = next_layer(now);
  if (!first) return false;
  const double deadline = deadline_of(*first);
  const std::uint64_t offset = file_offset(*first), bytes = stored_bytes(*first);
  out.push_back({offset, bytes, {{*first, offset, bytes}}, jumps_, now, generation_});
  if (!reserve(*first, deadline)) {
    out.pop_back();
    waits_for_memory_ = true;
    const bool budget_is_full = requests_.empty() && !is_decoding();
    if (budget_is_full) full_from_ = std::min(full_from_, deadline);
    // Playback must not wait forever for a layer that does not fit.
    const bool is_layer0 = layer_of(reader_->segments()[first->segment], first->sh, tiers_) == 0;
    if (is_layer0 && budget_is_full && need_for(*first).from <= settings_.resume_seconds) {
      mark_failed(
          *first, false, PlayerEvent::Kind::kReadFailed,
          runtime_error("{}: the active segments take more memory than the budget of {} bytes; "
                        "allow more memory",
                        source_->name(), settings_.memory_budget));
    }
    return false;
  }
  extend(out.back(), deadline, now);
  return true;
}

// Extends a request by the layers that follow it in the file if they are about as urgent as the
// first one, which they delay, or so small that they arrive sooner than by a request of their own.
void SegmentStore::extend(FetchRequest& request, double deadline, double now) {
  const SegmentLayer first = request.layers[0].layer;
  const double similar = deadline <= 0 ? 0 : deadline + settings_.layer_lead_seconds;
  const double extra_bytes = deadline <= 0 ? 0 : kMaxExtraSeconds * throughput_.bytes_per_second();
  std::size_t at = file_index(first);
  while (++at < file_order_.size()) {
    const SegmentLayer& layer = file_order_[at];
    const std::uint64_t end = request.offset + request.bytes, begin = file_offset(layer);
    if (begin < end || begin - end > kMaxGap) return;
    const std::uint64_t bytes = begin - request.offset + stored_bytes(layer);
    const double limit = static_cast<double>(bytes) <= extra_bytes ? kNever : similar;
    if (bytes > kMaxRequest || !is_fetchable(layer, now) || !arrives_in_time(layer) ||
        deadline_of(layer) > limit)
      return;
    request.layers.push_back({layer, begin, stored_bytes(layer)});
    if (!reserve(layer, deadline_of(layer))) return request.layers.pop_back();
    request.bytes = bytes;
  }
}

// Cancels a request that has not begun.
void SegmentStore::cancel(const FetchRequest& request) noexcept {
  for (const LocatedLayer& own : request.layers) {
    if (state_of(own.layer).state == LoadState::kInFlight) release(own.layer, LoadState::kMissing);
  }
}

void SegmentStore::run_fetcher() {
  bool out_of_memory = false;  // reported once
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    FetchRequests own;
    bool found = false;
    try {
      found = next_request(clock_seconds(), own);
      out_of_memory = false;
    } catch (const std::exception& e) {
      for (const FetchRequest& request : own) cancel(request);
      if (!std::exchange(out_of_memory, true)) {
        append_event(event_of(PlayerEvent::Kind::kReadFailed, 0, code_of(e), kNoMemory));
      }
    }
    if (!found) {
      // With a timeout, since failed layers are retried.
      to_fetch_.wait_for(lock, std::chrono::milliseconds(100));
      continue;
    }
    requests_.splice(requests_.begin(), own);
    const auto request = requests_.begin();
    throughput_.begin(clock_seconds());
    lock.unlock();
    std::vector<std::uint8_t> bytes;
    Status status;
    try {
      status = fetch(*request, bytes);
      if (status.ok() && bytes.size() == request->bytes) insert_ranges(*request, bytes);
    } catch (const std::exception& e) {
      bytes.clear();
      status = failure(e, [&] {
        return fmt::format("{}: cannot read {} bytes: {}", source_->name(), request->bytes,
                           e.what());
      });
    }
    const bool complete = status.ok() && bytes.size() == request->bytes;
    lock.lock();
    throughput_.end(clock_seconds());
    own.splice(own.begin(), requests_, request);
    finish(own.front(), complete, status);
    to_fetch_.notify_all();
  }
}

// Returns the bytes of the next read.
std::size_t SegmentStore::read_size(const FetchRequest& request) const {
  const std::lock_guard lock(mutex_);
  const double speed = throughput_.bytes_per_second();
  const double bytes = speed > 0 ? std::clamp(kReadSeconds * speed, kMinRead, kMaxRead) : kMaxRead;
  return static_cast<std::size_t>(std::min(bytes, static_cast<double>(request.bytes)));
}

// Returns whether to give up the rest of a request: after a seek, other layers are more urgent.
bool SegmentStore::is_abandoned(const FetchRequest& request) const {
  return stopping_ || request.generation != generation_ ||
         (request.jumps != jumps_ &&
          deadline_of(request.layers[0].layer) > settings_.layer_lead_seconds);
}

// Returns whether no part of a request from the offset `from` on is needed soon after a seek.
bool SegmentStore::is_obsolete(const FetchRequest& request, std::uint64_t from) const {
  if (stopping_ || request.generation != generation_) return true;
  const auto is_unneeded = [&](const LocatedLayer& own) {
    return own.offset + own.bytes <= from ||
           need_for(own.layer).from > settings_.layer_lead_seconds;
  };
  return request.jumps != jumps_ &&
         std::all_of(request.layers.begin(), request.layers.end(), is_unneeded);
}

// Reads the bytes of a request. Returns none if it is given up.
Status SegmentStore::fetch(const FetchRequest& request, std::vector<std::uint8_t>& bytes) {
  bytes.resize(static_cast<std::size_t>(request.bytes));
  for (std::size_t done = 0; done < bytes.size();) {
    const std::size_t part = std::min(read_size(request), bytes.size() - done);
    // Interrupting a read closes its connection.
    const double started_at = clock_seconds();
    bool ended = false;
    const auto should_continue = [&] {
      if (clock_seconds() - started_at < kMaxReadSeconds) return true;
      const std::lock_guard lock(mutex_);
      return !(ended = is_obsolete(request, request.offset + done));
    };
    bool read = false;
    const Status status = source_->fetch(should_continue, request.offset + done,
                                         std::span(bytes).subspan(done, part), read);
    done += part;
    if (!status.ok() && !ended) return status;
    const std::lock_guard lock(mutex_);
    if (status.ok() && read) throughput_.add_bytes(part, clock_seconds());
    if (status.ok()) fetched_bytes_ += part;
    if (!status.ok()) throughput_.reset();  // it may have stalled
    if (!status.ok() || (done < bytes.size() && is_abandoned(request))) {
      bytes.clear();
      return {};
    }
  }
  return {};
}

void SegmentStore::insert_ranges(const FetchRequest& request, std::span<const std::uint8_t> bytes) {
  for (const LocatedLayer& own : request.layers) {
    source_->insert(own.offset, bytes.subspan(static_cast<std::size_t>(own.offset - request.offset),
                                              static_cast<std::size_t>(own.bytes)));
  }
}

// Handles the end of a request: `complete`, given up, or failed.
void SegmentStore::finish(const FetchRequest& request, bool complete,
                          const Status& status) noexcept {
  for (const auto& [layer, offset, bytes] : request.layers) {
    if (request.generation != generation_) {
      source_->erase(offset);
    } else if (complete) {
      state_of(layer).state = LoadState::kResident;
    } else {
      release(layer, LoadState::kMissing);
      if (!status.ok() && !stopping_)
        mark_failed(layer, false, PlayerEvent::Kind::kReadFailed, status);
    }
  }
  to_decode_.notify_all();
  if (!status.ok() && !is_live() && source_->has_shrunk()) set_replaced(true);
  // The throughput before a failure does not predict the throughput after it.
  if (!status.ok()) throughput_.reset();
}

// Returns whether a Follower checks whether the file was replaced.
bool SegmentStore::is_live() const {
  return settings_.live.follow && reader_->form() == SceneForm::kGrowing;
}

void SegmentStore::set_replaced(bool replaced) noexcept {
  if (std::exchange(is_replaced_, replaced) != replaced) on_replaced_(replaced);
}

}  // namespace stgs::player
