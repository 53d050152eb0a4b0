// SPDX-License-Identifier: Apache-2.0
#include "lifespans.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "segmenter.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stream.h"

namespace stgs {
namespace {

constexpr int kTimeBits = 23, kFineTimeBits = 19;  // of a moment in steps
// T may lie so many times a part's length, and so many ticks, from its beginning.
constexpr double kReach = 4.0, kLeastReach = 4096.0;
constexpr float kLogitLimit = 12.0f;
constexpr float kSigmaMin = 1.0f / 1024.0f;  // ticks
constexpr float kSigmaMax = 1e9f;
// Of a part of up to 2^32 ticks, at least the half that is to be seen around T; below 2^32, where a
// radius has more bits than 24.
constexpr float kRadiusMax = 0x1.fp31f;
constexpr int kMostHalvings = 12;  // of steps of T
// Of units in the last place: those up to the greatest radius have 24 bits then (spec 7.5).
constexpr int kLeastLifespan = 4;
// Ticks: what fades faster does so between two frames, sigma sqrt(ln 255) being less than one.
constexpr float kHardSigma = 0.42f;
constexpr double kEdgeMargin = 1.0 / 16.0;  // ticks that a hard edge keeps from a frame
constexpr double kEdgeVisibility = 0.25;    // that a frame in a hard edge may be off

// By 2^halvings finer, where a step can be.
Step finer(Step step, int halvings, int least_exponent) {
  return {std::max(least_exponent, step.exponent - halvings), step.multiplier};
}
Step finer_time(Step step, int halvings) {
  return finer(step, halvings, kMinExponent);
}
Step finer_lifespan(Step step, int halvings) {
  return finer(step, halvings, kLeastLifespan);
}

float on_lifespan_grid(float x, Step step) {
  return from_truncated(truncated_steps(x, step), step);
}

Lifespan lifespan_of(const Gaussians4D& set, std::size_t i) {
  return {set.time[i], set.sigma[i], set.radius[i], math::opacity_of(set.opacity_logit[i])};
}

// The frames of the timeline that fall into a part, ticks of the part.
struct FrameRange {
  double first = 0, last = 0;
  explicit FrameRange(const Interval& part)
      : first(std::ceil(part.begin) - part.begin), last(std::floor(part.end) - part.begin) {}
};

// The first and the last frame at which a lifespan is seen; none where begin > end.
Interval seen_frames(const Lifespan& life, const FrameRange& frames) {
  const double fade = life.fade();
  if (fade < 0.0) return {1.0, 0.0};
  const double begin = life.time - life.radius - fade, end = life.time + life.radius + fade;
  return {frames.first + std::ceil(std::max(begin, frames.first) - frames.first),
          frames.first + std::floor(std::min(end, frames.last) - frames.first)};
}

// Radii, around T, with which the frames of `seen` are seen and the ones beside them are not.
Interval radii_for(const Interval& seen, const FrameRange& frames, double time, double fade) {
  const double least = std::max(time - seen.begin, seen.end - time) + kEdgeMargin - fade;
  double most = HUGE_VAL;
  if (seen.begin > frames.first) most = std::min(most, time - seen.begin + 1.0);
  if (seen.end < frames.last) most = std::min(most, seen.end + 1.0 - time);
  return {std::max(0.0, least), most - kEdgeMargin - fade};
}

bool same_frames(const Lifespan& was, const Lifespan& is, const Interval& seen,
                 const FrameRange& frames) {
  const Interval now = seen_frames(is, frames);
  if (seen.begin > seen.end) return now.begin > now.end;
  if (now.begin != seen.begin || now.end != seen.end) return false;
  return std::abs(was.visibility(seen.begin) - is.visibility(seen.begin)) <= kEdgeVisibility &&
         std::abs(was.visibility(seen.end) - is.visibility(seen.end)) <= kEdgeVisibility;
}

// T and r on these grids with which `life` is seen at the same frames as `was`, near to its own if
// they can be.
std::optional<Lifespan> hard_edged(const Lifespan& was, Lifespan life, const FrameRange& frames,
                                   Step time, Step lifespan) {
  const Interval seen = seen_frames(was, frames);
  const bool none = seen.begin > seen.end;
  const double fade = life.fade();
  for (const double centre : {was.time, none ? was.time : 0.5 * (seen.begin + seen.end)}) {
    life.time = on_grid(static_cast<float>(centre), time);
    const Interval radii =
        none ? Interval{0.0, was.radius} : radii_for(seen, frames, life.time, fade);
    const double middle = std::min(0.5 * (radii.begin + radii.end), radii.begin + was.radius);
    for (const double wanted : {double{was.radius}, middle}) {
      life.radius = on_lifespan_grid(static_cast<float>(wanted) + 1.0f, lifespan) - 1.0f;
      if (!none && !(life.radius >= radii.begin && life.radius <= radii.end)) continue;
      if (same_frames(was, life, seen, frames)) return life;
    }
  }
  return std::nullopt;
}

double length_of(const Interval& part) {
  return part.end - part.begin;
}

// T and r on these grids with which `life` is seen in its part and begins and ends as `was` does,
// within `bound` ticks, wherever that is in its part.
std::optional<Lifespan> soft_edged(const Lifespan& was, Lifespan life, double length, double bound,
                                   Step time, Step lifespan) {
  const double begin = was.time - was.radius, end = was.time + was.radius;
  life.time = on_grid(static_cast<float>(was.time), time);
  double wanted = was.radius;
  if (begin <= 0.0 && end < length) wanted = end - life.time;  // makes up for T's rounding
  if (begin > 0.0 && end >= length) wanted = life.time - begin;
  wanted = std::clamp(wanted, 0.0, double{kRadiusMax});
  life.radius = on_lifespan_grid(static_cast<float>(wanted) + 1.0f, lifespan) - 1.0f;
  const double seen = life.radius + life.fade();
  if (life.time - seen >= length || life.time + seen <= 0.0) return std::nullopt;
  const auto moved = [length](double from, double to) {
    return std::abs(std::clamp(from, 0.0, length) - std::clamp(to, 0.0, length));
  };
  const bool kept = moved(begin, life.time - life.radius) <= bound &&
                    moved(end, life.time + life.radius) <= bound;
  return kept ? std::optional(life) : std::nullopt;
}

void set_time(double time, std::size_t i, Gaussians4D& set) {
  for (std::size_t c = 0; c < 3; ++c) {  // where it is then
    float& x = set.position[3 * i + c];
    x = static_cast<float>(x + double{set.velocity[3 * i + c]} * (time - set.time[i]));
  }
  set.time[i] = static_cast<float>(time);
}

// One opacity for all of a part, T in its middle.
void hold(double length, double opacity, std::size_t i, Gaussians4D& set) {
  set.opacity_logit[i] = static_cast<float>(std::log(opacity / (1.0 - opacity)));
  set_time(0.5 * length, i, set);
  set.sigma[i] = 1.0f;
  set.radius[i] = static_cast<float>(length);
}

// What moves little in its part and hardly changes its opacity: at rest in its middle, at its mean
// opacity.
void make_constant(double length, const LifespanBounds& bounds, std::size_t i, Gaussians4D& set) {
  const Lifespan life = lifespan_of(set, i);
  const double most = life.visibility(std::clamp(life.time, 0.0, length));
  const double least = life.visibility(life.time < 0.5 * length ? length : 0.0);
  float* u = &set.velocity[3 * i];
  const double way =
      length * std::sqrt(double{u[0]} * u[0] + double{u[1]} * u[1] + double{u[2]} * u[2]);
  // A hard edge is no change of which half comes too early and half too late.
  const bool edge = life.sigma < kHardSigma && least < most;
  if (edge || life.opacity * (most - least) > 2.0 * bounds.even || way > bounds.still) return;
  hold(length, life.opacity * 0.5 * (most + least), i, set);
  std::fill_n(u, 3, 0.0f);
}

// A lifespan that is seen alike within its part, whose numbers are as small as they can be and
// count from where it is seen.
void bring_in(double length, std::size_t i, Gaussians4D& set) {
  const double time = set.time[i], radius = set.radius[i];
  if (time - radius <= 0.0 && time + radius >= length) {  // seen all the time
    set_time(0.5 * length, i, set);
    set.sigma[i] = 1.0f;
    set.radius[i] = static_cast<float>(length);
    return;
  }
  const FlatTop top = brought_in({time, radius}, length);
  if (top.time == time) return;
  set_time(top.time, i, set);
  set.radius[i] = static_cast<float>(top.radius);
}

// T within reach of a part. Of what is so far away and still seen, the opacity hardly changes.
void bring_near(double length, double reach, std::size_t i, Gaussians4D& set) {
  if (std::abs(set.time[i]) <= reach) return;
  const Lifespan life = lifespan_of(set, i);
  hold(length, life.opacity * life.visibility(0.5 * length), i, set);
}

}  // namespace

double Lifespan::visibility(double t) const {
  return math::visibility(static_cast<float>(t - time), sigma, radius);
}

double Lifespan::fade() const {
  return math::support_half_width(opacity, sigma, 0.0f, math::kAlphaThreshold);
}

FlatTop brought_in(FlatTop top, double length) {
  const double inside = std::clamp(top.time, 0.0, length);
  const double way = std::clamp(inside - top.time, -top.radius, top.radius);
  return {top.time + way, top.radius - std::abs(way)};
}

LifespanGrids::LifespanGrids(double longest_part, double time, double lifespan, Step opacity,
                             LifespanBounds bounds)
    : time_(step_near(time, kFineSteps)),
      lifespan_(step_near(lifespan, kFineSteps)),
      opacity_(opacity),
      bounds_(bounds),
      reach_(std::max(kReach * longest_part, kLeastReach)) {
  if (reach_ >= std::ldexp(size_of(time_), kFineTimeBits)) {  // powers of two have more bits
    const double least = std::ceil(std::log2(reach_)) - kTimeBits;
    time_ = coarser_of(step_near(time, 1), power_above(least));
  }
  const auto fits = [this](int halvings) {
    const Step step = finer_time(time_, halvings);
    return nearest(reach_, step) < max_steps(Mapping::kTime, step.multiplier) / 2;
  };
  while (finest_time_ < kMostHalvings && fits(finest_time_ + 1)) ++finest_time_;
}

void LifespanGrids::snap(const Interval& interval, std::size_t i, Gaussians4D& set) const {
  const double length = length_of(interval);
  if (lifetime_of(set, i, length).never) return;
  make_constant(length, bounds_, i, set);
  bring_in(length, i, set);
  bring_near(length, reach_, i, set);
  const Lifespan was = lifespan_of(set, i);
  float& logit = set.opacity_logit[i];
  logit = on_grid(std::clamp(logit, -kLogitLimit, kLogitLimit), opacity_);
  while (math::opacity_of(logit) < math::kAlphaThreshold) {
    logit += static_cast<float>(size_of(opacity_));
  }
  Lifespan life = was;
  life.opacity = math::opacity_of(logit);
  life.sigma = on_lifespan_grid(std::clamp(was.sigma, kSigmaMin, kSigmaMax), lifespan_);
  life = rounded(was, life, interval);
  set_time(life.time, i, set);
  set.sigma[i] = life.sigma;
  set.radius[i] = life.radius;
}

Lifespan LifespanGrids::rounded(const Lifespan& was, Lifespan life,
                                const Interval& interval) const {
  const FrameRange frames(interval);
  const double length = length_of(interval);
  const double bound = std::max(bounds_.edge * was.sigma, size_of(time_));
  for (int halved = 0; halved <= kMostHalvings; ++halved) {
    const Step time = finer_time(time_, std::min(halved, finest_time_));
    if (was.sigma < kHardSigma) {
      const auto kept = hard_edged(was, life, frames, time, finer_lifespan(lifespan_, halved));
      if (kept) return *kept;
      continue;
    }
    for (int halvings = 0; halvings <= lifespan_.exponent - kLeastLifespan; ++halvings) {
      const Step lifespan = finer_lifespan(lifespan_, halvings);
      if (const auto kept = soft_edged(was, life, length, bound, time, lifespan)) return *kept;
    }
  }
  life.time = on_grid(static_cast<float>(was.time), finer_time(time_, finest_time_));
  const Step finest = finer_lifespan(lifespan_, lifespan_.exponent);
  life.radius = on_lifespan_grid(std::min(was.radius, kRadiusMax) + 1.0f, finest) - 1.0f;
  return life;
}

LifespanSteps LifespanGrids::steps_of(const Gaussians4D& set,
                                      const std::vector<std::uint32_t>& members) const {
  int time = 0, radius = 0;
  for (const std::uint32_t i : members) {
    while (time < finest_time_ && on_grid(set.time[i], finer_time(time_, time)) != set.time[i]) {
      ++time;
    }
    const float r = set.radius[i] + 1.0f;
    while (lifespan_.exponent - radius > kLeastLifespan &&
           on_lifespan_grid(r, finer_lifespan(lifespan_, radius)) != r) {
      ++radius;
    }
  }
  return {finer_time(time_, time), lifespan_, finer_lifespan(lifespan_, radius)};
}

}  // namespace stgs
