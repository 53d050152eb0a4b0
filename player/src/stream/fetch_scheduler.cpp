// SPDX-License-Identifier: Apache-2.0
#include "stream/fetch_scheduler.h"

#include <algorithm>
#include <utility>

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

// Returns the current throughput; infinity: not known yet.
double FetchScheduler::expected_speed() const {
  const double speed = throughput_.bytes_per_second();
  return speed == 0 ? kNever : speed;
}

// Returns until when a request that the viewer waits for has the link to itself; `now`: there is no
// such request.
double FetchScheduler::exclusive_until(double now) const {
  double until = now;
  for (const FetchRequest& request : requests_) {
    if (request.generation == index_.generation() &&
        deadlines_.deadline(request.layers[0].layer) <= 0)
      until = std::max(until, request.started_at + kExclusiveSeconds);
  }
  return until;
}

// Returns the most urgent layer. While the viewer waits for one, no other layer competes for
// bandwidth. Layers that would arrive too late are attempted only if nothing is in flight, in case
// the link has become faster.
std::optional<SegmentLayer> FetchScheduler::next_layer(double now, double& wake_at) {
  const double exclusive = exclusive_until(now);
  if (exclusive > now) wake_at = exclusive;
  plan_.update(now);
  wake_at = std::min(wake_at, plan_.retry_at());
  std::optional<SegmentLayer> best = plan_.first(expected_speed());
  if (!best && requests_.empty()) best = plan_.first(kNever);
  const bool competes = best && exclusive > now && deadlines_.deadline(*best) > 0;
  return competes ? std::nullopt : best;
}

FetchScheduler::Next FetchScheduler::next(double now) {
  Next out;
  if (!deadlines_.has_playhead()) return out;
  const std::optional<SegmentLayer> first = next_layer(now, out.wake_at);
  if (!first) return out;
  const double deadline = deadlines_.deadline(*first);
  const LocatedLayer located = index_.locate(*first);
  std::list<FetchRequest> own(1);
  FetchRequest& request = own.front();
  request.id = last_id_ + 1;
  request.offset = located.offset;
  request.bytes = located.bytes;
  request.layers.push_back(located);
  request.jumps = deadlines_.jumps();
  request.generation = index_.generation();
  request.started_at = now;
  if (!residency_.begin_fetch(*first, deadline)) {
    const bool budget_is_full = requests_.empty() && !residency_.is_decoding();
    if (budget_is_full) residency_.set_full_from(deadline);
    // Playback must not wait forever for a layer that does not fit.
    if (index_.layer_number(*first) == 0 && budget_is_full &&
        deadlines_.need(first->segment).from <= settings_.resume_seconds)
      out.too_large = first;
    return out;
  }
  try {
    extend(request, deadline, now);
  } catch (...) {
    cancel(request);
    throw;
  }
  ++last_id_;
  requests_.splice(requests_.begin(), own);
  out.request = &requests_.front();
  return out;
}

// Extends a request by the layers that follow it in the file if they are about as urgent as the
// first one, which they delay, or so small that they arrive sooner than by a request of their own.
void FetchScheduler::extend(FetchRequest& request, double deadline, double now) {
  const SegmentLayer first = request.layers[0].layer;
  const double similar = deadline <= 0 ? 0 : deadline + deadlines_.layer_lead_seconds();
  const double extra_bytes = deadline <= 0 ? 0 : kMaxExtraSeconds * throughput_.bytes_per_second();
  const double speed = expected_speed();
  for (std::size_t at = index_.file_index(first) + 1; at < index_.file_order().size(); ++at) {
    const LocatedLayer next = index_.locate(index_.file_order()[at]);
    const std::uint64_t end = request.offset + request.bytes;
    if (next.offset < end || next.offset - end > kMaxGap) return;
    const std::uint64_t bytes = next.offset - request.offset + next.bytes;
    const double limit = static_cast<double>(bytes) <= extra_bytes ? kNever : similar;
    const double own = deadlines_.deadline(next.layer);
    if (bytes > kMaxRequest || !plan_.is_fetchable(next.layer, now) ||
        plan_.min_speed(next.layer) > speed || own > limit)
      return;
    request.layers.push_back(next);
    if (!residency_.begin_fetch(next.layer, own)) return request.layers.pop_back();
    request.bytes = bytes;
  }
}

// Cancels a request that is not in flight yet.
void FetchScheduler::cancel(const FetchRequest& request) noexcept {
  for (const LocatedLayer& own : request.layers) {
    if (residency_.state(own.layer) == LoadState::kInFlight) residency_.fetch_cancelled(own.layer);
  }
}

std::uint64_t FetchScheduler::read_size(const FetchRequest& request) const {
  const double speed = throughput_.bytes_per_second();
  const double bytes = speed > 0 ? std::clamp(kReadSeconds * speed, kMinRead, kMaxRead) : kMaxRead;
  return std::min(static_cast<std::uint64_t>(bytes), request.bytes - request.done);
}

void FetchScheduler::begin_read(FetchRequest& request, double now) {
  request.read_bytes = read_size(request);
  request.read_started_at = now;
  request.read_cancelled = false;
}

FetchScheduler::Progress FetchScheduler::end_read(FetchRequest& request, bool ok,
                                                  std::optional<double> busy_seconds) {
  const std::uint64_t read = std::exchange(request.read_bytes, 0);
  if (!ok) {
    // The link may have stalled. The throughput before a failure does not predict the later one.
    throughput_.reset();
    return request.read_cancelled ? Progress::kGivenUp : Progress::kFailed;
  }
  if (busy_seconds) throughput_.add_bytes(read, *busy_seconds);
  fetched_bytes_ += read;
  request.done += read;
  if (request.done == request.bytes) return Progress::kComplete;
  return is_abandoned(request) ? Progress::kGivenUp : Progress::kMore;
}

FetchRequest* FetchScheduler::next_cancelled(double now, double& wake_at) {
  for (FetchRequest& request : requests_) {
    if (request.read_bytes == 0 || request.read_cancelled || !is_obsolete(request)) continue;
    const double at = request.read_started_at + kMaxReadSeconds;
    if (now >= at) {
      request.read_cancelled = true;
      return &request;
    }
    wake_at = std::min(wake_at, at);
  }
  return nullptr;
}

// Returns whether to give up the rest of a request: after a seek, other layers are more urgent.
bool FetchScheduler::is_abandoned(const FetchRequest& request) const {
  return request.generation != index_.generation() ||
         (request.jumps != deadlines_.jumps() &&
          deadlines_.deadline(request.layers[0].layer) > deadlines_.layer_lead_seconds());
}

// Returns whether nothing that a request still has to read is needed soon after a seek.
bool FetchScheduler::is_obsolete(const FetchRequest& request) const {
  if (request.generation != index_.generation()) return true;
  const std::uint64_t from = request.offset + request.done;
  const auto is_unneeded = [&](const LocatedLayer& own) {
    return own.offset + own.bytes <= from ||
           deadlines_.need(own.layer.segment).from > deadlines_.layer_lead_seconds();
  };
  return request.jumps != deadlines_.jumps() &&
         std::all_of(request.layers.begin(), request.layers.end(), is_unneeded);
}

FetchRequest& FetchScheduler::find(std::uint64_t id) {
  return *std::find_if(requests_.begin(), requests_.end(),
                       [id](const FetchRequest& request) { return request.id == id; });
}

std::list<FetchRequest> FetchScheduler::finish(FetchRequest& request, bool complete) noexcept {
  std::list<FetchRequest> out;
  const auto at = std::find_if(requests_.begin(), requests_.end(),
                               [&](const FetchRequest& one) { return &one == &request; });
  out.splice(out.begin(), requests_, at);
  if (request.generation != index_.generation()) return out;
  for (const LocatedLayer& own : request.layers) {
    complete ? residency_.fetched(own.layer) : residency_.fetch_cancelled(own.layer);
  }
  return out;
}

}  // namespace stgs::player
