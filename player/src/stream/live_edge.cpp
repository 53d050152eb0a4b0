// SPDX-License-Identifier: Apache-2.0
#include "stream/live_edge.h"

#include <algorithm>
#include <cmath>

namespace stgs::player {
namespace {

constexpr std::size_t kMaxArrivals = 16;  // by which the jitter is measured
// Latency beyond the fragment and its jitter, seconds: display and polling are not synchronised
// with the arrivals.
constexpr double kMargin = 0.05;
constexpr double kTolerance = 0.02;     // seconds from the target that are not corrected
constexpr double kCatchUpSeconds = 2;   // in which a distance to the target is made up, if possible
constexpr double kMaxRateChange = 0.1;  // hardly noticeable
// Seconds by which an arrival must deviate, at least, to discard the earlier ones.
constexpr double kMinDiscontinuity = 1;

}  // namespace

void LiveEdge::observe(double edge, double fragment, double now) {
  if (!has_observed_) {
    has_observed_ = true;
    edge_ = edge;
    first_ahead_ = edge - now;
    return;
  }
  if (!(edge > edge_)) return;
  const Arrival arrival{edge - now, fragment};
  edge_ = edge;
  // The recorder paused, or is catching up: earlier arrivals are no longer representative.
  const double limit = std::max(kMinDiscontinuity, 2 * std::max(arrival.fragment, fragment_));
  if (!arrivals_.empty() && std::abs(arrival.ahead - max_ahead()) > limit) arrivals_.clear();
  arrivals_.push_back(arrival);
  if (arrivals_.size() > kMaxArrivals) arrivals_.pop_front();
}

double LiveEdge::max_ahead() const {
  if (arrivals_.empty()) return first_ahead_;
  double result = arrivals_.front().ahead;
  for (const Arrival& arrival : arrivals_) result = std::max(result, arrival.ahead);
  return result;
}

double LiveEdge::max_fragment() const {
  double result = arrivals_.empty() ? fragment_ : 0;
  for (const Arrival& arrival : arrivals_) result = std::max(result, arrival.fragment);
  return result;
}

double LiveEdge::jitter() const {
  double min_ahead = max_ahead();
  for (const Arrival& arrival : arrivals_) min_ahead = std::min(min_ahead, arrival.ahead);
  return max_ahead() - min_ahead;
}

double LiveEdge::edge(double now) const {
  if (!has_observed_) return edge_;
  return std::clamp(now + max_ahead(), edge_, edge_ + max_fragment() + jitter());
}

double LiveEdge::target_latency() const {
  return std::max(settings_.latency_seconds, max_fragment() + jitter() + kMargin);
}

double LiveEdge::rate_factor(double time, double now) const {
  const double late = target(now) - time;
  if (std::abs(late) <= kTolerance) return 1;
  return 1 + std::clamp(late / kCatchUpSeconds, -kMaxRateChange, kMaxRateChange);
}

bool LiveEdge::should_skip(double time, double now) const {
  return target(now) - time > settings_.skip_seconds;
}

}  // namespace stgs::player
