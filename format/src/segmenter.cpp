// SPDX-License-Identifier: Apache-2.0
#include "segmenter.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs {
namespace {

// A support is widened by this much, so that rounding in a renderer cannot step out of it.
double slack(double time, double half) {
  return 1e-3 + 1e-6 * (std::abs(time) + half);
}

}  // namespace

Lifetime lifetime_of(float opacity_logit, float time, float sigma, float radius,
                     std::uint32_t frames) {
  const float opacity = math::opacity_of(opacity_logit);
  const double half =
      math::support_half_width(opacity * 1.000001f, sigma, radius, math::kAlphaThreshold);
  if (half < 0.0) return {0, 0, true};
  const double reach = half + slack(time, half);
  if (time + reach < 0.0 || time - reach >= frames) return {0, 0, true};
  return {std::max(0.0, time - reach), std::min<double>(frames, time + reach), false};
}

Lifetime within(const Lifetime& lifetime, const Interval& interval) {
  const Lifetime cut = {std::max(lifetime.begin, interval.begin),
                        std::min(lifetime.end, interval.end), lifetime.never};
  return cut.never || cut.begin >= cut.end ? Lifetime{0, 0, true} : cut;
}

Place place_of(const Lifetime& lifetime, double chunk_ticks, std::uint32_t frames) {
  if (lifetime.never || lifetime.end - lifetime.begin > 0.5 * frames) return {};
  for (int level = 0; std::ldexp(chunk_ticks, level) < frames; ++level) {
    const double half = std::ldexp(chunk_ticks, level - 1);
    double slot = std::floor(lifetime.begin / half);
    if (slot > 0.0 && slot * half > lifetime.begin) slot -= 1.0;
    const Interval interval =
        interval_of(level, static_cast<std::uint32_t>(slot), chunk_ticks, frames);
    if (lifetime.end < interval.end || interval.end >= frames) {
      return {static_cast<std::int16_t>(level), static_cast<std::uint32_t>(slot)};
    }
  }
  return {};
}

std::vector<SegmentMembers> segments_of(const Gaussians4D& set, const PartRange& part,
                                        double chunk_ticks, std::uint32_t frames,
                                        bool keep_never_visible) {
  // Beginning, then the longer first.
  std::map<std::pair<double, int>, SegmentMembers> segments;
  for (std::uint32_t i = part.first; i < part.last; ++i) {
    const Lifetime lifetime =
        within(lifetime_of(set.opacity_logit[i], set.time[i], set.sigma[i], set.radius[i], frames),
               part.interval);
    if (lifetime.never && !keep_never_visible) continue;
    const Place place = place_of(lifetime, chunk_ticks, frames);
    const double begin = interval_of(place.level, place.slot, chunk_ticks, frames).begin;
    SegmentMembers& segment =
        segments[{begin, place.level < 0 ? -1000 : -static_cast<int>(place.level)}];
    segment.place = place;
    segment.members.push_back(i);
  }
  std::vector<SegmentMembers> out;
  out.reserve(segments.size());
  for (auto& [key, segment] : segments) out.push_back(std::move(segment));
  return out;
}

}  // namespace stgs
