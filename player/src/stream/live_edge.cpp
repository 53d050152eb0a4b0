// SPDX-License-Identifier: Apache-2.0
#include "stream/live_edge.h"

#include <algorithm>
#include <cmath>

namespace stgs::player {
namespace {

constexpr std::size_t kArrivals = 16;  // that tell how evenly stretches come
// Beyond a stretch and its delay, seconds: displays show moments of their own, and looks for the
// edge have theirs.
constexpr double kMargin = 0.05;
constexpr double kNear = 0.02;      // seconds from the target that are left alone
constexpr double kCatchUp = 2;      // seconds in which a distance is made up for, if it can be
constexpr double kMostPace = 0.1;   // of the rate: hardly seen
constexpr double kAnotherPace = 1;  // seconds that an arrival is off by, at least, to begin anew

}  // namespace

void LiveEdge::observe(double edge, double stretch, double now) {
  if (!joined_) {
    joined_ = true;
    edge_ = edge;
    first_ahead_ = edge - now;
    return;
  }
  if (!(edge > edge_)) return;
  const Arrival arrival{edge - now, stretch};
  edge_ = edge;
  // A recorder that stood still, or has much to make up for: what was before tells nothing.
  const double most = std::max(kAnotherPace, 2 * std::max(arrival.stretch, stretch_));
  if (!arrivals_.empty() && std::abs(arrival.ahead - earliest()) > most) arrivals_.clear();
  arrivals_.push_back(arrival);
  if (arrivals_.size() > kArrivals) arrivals_.pop_front();
}

double LiveEdge::earliest() const {
  if (arrivals_.empty()) return first_ahead_;
  double most = arrivals_.front().ahead;
  for (const Arrival& arrival : arrivals_) most = std::max(most, arrival.ahead);
  return most;
}

double LiveEdge::longest() const {
  double most = arrivals_.empty() ? stretch_ : 0;
  for (const Arrival& arrival : arrivals_) most = std::max(most, arrival.stretch);
  return most;
}

double LiveEdge::jitter() const {
  double least = earliest();
  for (const Arrival& arrival : arrivals_) least = std::min(least, arrival.ahead);
  return earliest() - least;
}

double LiveEdge::edge(double now) const {
  if (!joined_) return edge_;
  return std::clamp(now + earliest(), edge_, edge_ + longest() + jitter());
}

double LiveEdge::target_latency() const {
  return std::max(settings_.latency_seconds, longest() + jitter() + kMargin);
}

double LiveEdge::rate_factor(double moment, double now) const {
  const double late = target(now) - moment;
  if (std::abs(late) <= kNear) return 1;
  return 1 + std::clamp(late / kCatchUp, -kMostPace, kMostPace);
}

bool LiveEdge::should_skip(double moment, double now) const {
  return target(now) - moment > settings_.skip_seconds;
}

}  // namespace stgs::player
