// SPDX-License-Identifier: Apache-2.0
#include "quantise/lifespans.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "codec/stream.h"
#include "quantise/segmenter.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs {
namespace {

constexpr int kTimeBits = 23, kFineTimeBits = 19;  // of T in steps
// Bound of |T| from the beginning of a part: in multiples of the part's length, and at least in
// ticks.
constexpr double kReach = 4.0, kMinReach = 4096.0;
constexpr float kSigmaMin = 1.0f / 1024.0f;  // ticks
constexpr float kSigmaMax = 1e9f;
// At least half of a part of up to 2^32 ticks, but below 2^32, where a radius needs more than 24
// bits.
constexpr float kRadiusMax = 0x1.fp31f;
constexpr int kMaxHalvings = 12;  // of the step of T
// log2 of the finest lifespan step, units in the last place: keeps the greatest radius within 24
// bits (spec 8.5).
constexpr int kMinLifespanStep = 4;
// Ticks. A lower sigma fades out between two frames, because sigma sqrt(ln 255) < 1: a hard edge.
constexpr float kHardSigma = 0.42f;
constexpr double kEdgeMargin = 1.0 / 16.0;  // distance of a hard edge from a frame, ticks

// Returns a step finer by 2^halvings, but not below the given exponent.
Step finer(Step step, int halvings, int min_exponent) {
  return {std::max(min_exponent, step.exponent - halvings), step.multiplier};
}
Step finer_time(Step step, int halvings) {
  return finer(step, halvings, kMinExponent);
}
Step finer_lifespan(Step step, int halvings) {
  return finer(step, halvings, kMinLifespanStep);
}

float on_lifespan_grid(float x, Step step) {
  return from_truncated(truncated_steps(x, step), step);
}

Lifespan lifespan_of(const Gaussians4D& set, std::size_t i) {
  return {set.time[i], set.sigma[i], set.radius[i], math::opacity_of(set.opacity_logit[i])};
}

// The first and last frame of the timeline within a part, ticks of the part.
struct FrameRange {
  double first = 0, last = 0;
  explicit FrameRange(const TickRange& part)
      : first(std::ceil(part.begin) - part.begin), last(std::floor(part.end) - part.begin) {}
};

// Returns the first and last frame at which a primitive is visible; none if begin > end.
TickRange visible_frames(const Lifespan& lifespan, const FrameRange& frames) {
  const double fade = lifespan.fade();
  if (fade < 0.0) return {1.0, 0.0};
  const double begin = lifespan.time - lifespan.radius - fade;
  const double end = lifespan.time + lifespan.radius + fade;
  return {frames.first + std::ceil(std::max(begin, frames.first) - frames.first),
          frames.first + std::floor(std::min(end, frames.last) - frames.first)};
}

// Returns the radii around `time` that show exactly the frames of `visible`.
TickRange radii_for(const TickRange& visible, const FrameRange& frames, double time, double fade) {
  const double low = std::max(time - visible.begin, visible.end - time) + kEdgeMargin - fade;
  double high = HUGE_VAL;
  if (visible.begin > frames.first) high = std::min(high, time - visible.begin + 1.0);
  if (visible.end < frames.last) high = std::min(high, visible.end + 1.0 - time);
  return {std::max(0.0, low), high - kEdgeMargin - fade};
}

// Returns whether `is` is visible at the frames of `visible`, as `was` is, with values of l that
// differ by at most `tolerance`.
bool same_frames(const Lifespan& was, const Lifespan& is, const TickRange& visible,
                 const FrameRange& frames, double tolerance) {
  const TickRange now = visible_frames(is, frames);
  if (visible.begin > visible.end) return now.begin > now.end;
  if (now.begin != visible.begin || now.end != visible.end) return false;
  const auto close = [&](double t) {
    return std::abs(was.visibility(t) - is.visibility(t)) <= tolerance;
  };
  return close(visible.begin) && close(visible.end);
}

// Returns `life` with T and r on these grids, visible at the same frames as `was`, with values of l
// that differ by at most `tolerance`, and as near as possible to it.
std::optional<Lifespan> hard_edged(const Lifespan& was, Lifespan life, const FrameRange& frames,
                                   double tolerance, Step time, Step lifespan) {
  const TickRange visible = visible_frames(was, frames);
  const bool none = visible.begin > visible.end;
  const double fade = life.fade();
  for (const double centre : {was.time, none ? was.time : 0.5 * (visible.begin + visible.end)}) {
    life.time = on_grid(static_cast<float>(centre), time);
    const TickRange radii =
        none ? TickRange{0.0, was.radius} : radii_for(visible, frames, life.time, fade);
    const double middle = std::min(0.5 * (radii.begin + radii.end), radii.begin + was.radius);
    for (const double target : {double{was.radius}, middle}) {
      life.radius = on_lifespan_grid(static_cast<float>(target) + 1.0f, lifespan) - 1.0f;
      if (!none && !(life.radius >= radii.begin && life.radius <= radii.end)) continue;
      if (same_frames(was, life, visible, frames, tolerance)) return life;
    }
  }
  return std::nullopt;
}

double length_of(const TickRange& part) {
  return part.end - part.begin;
}

// Returns `life` with T and r on these grids, visible in its part, and with edges within `bound`
// ticks of those of `was`, as far as they lie in the part.
std::optional<Lifespan> soft_edged(const Lifespan& was, Lifespan life, double length, double bound,
                                   Step time, Step lifespan) {
  const double begin = was.time - was.radius, end = was.time + was.radius;
  life.time = on_grid(static_cast<float>(was.time), time);
  double target = was.radius;
  if (begin <= 0.0 && end < length) target = end - life.time;  // makes up for T's rounding
  if (begin > 0.0 && end >= length) target = life.time - begin;
  target = std::clamp(target, 0.0, double{kRadiusMax});
  life.radius = on_lifespan_grid(static_cast<float>(target) + 1.0f, lifespan) - 1.0f;
  const double half = life.radius + life.fade();
  if (life.time - half >= length || life.time + half <= 0.0) return std::nullopt;
  const auto moved = [length](double from, double to) {
    return std::abs(std::clamp(from, 0.0, length) - std::clamp(to, 0.0, length));
  };
  const bool close = moved(begin, life.time - life.radius) <= bound &&
                     moved(end, life.time + life.radius) <= bound;
  return close ? std::optional(life) : std::nullopt;
}

void set_time(double time, std::size_t i, Gaussians4D& set) {
  for (std::size_t c = 0; c < 3; ++c) {  // the position at the new T
    float& x = set.position[3 * i + c];
    x = static_cast<float>(x + double{set.velocity[3 * i + c]} * (time - set.time[i]));
  }
  set.time[i] = static_cast<float>(time);
}

// Returns the logit of the share l, 0..1, of an opacity, from the logit of that.
double logit_of_share(double logit, double l) {
  if (l == 1.0) return logit;
  return logit > 0.0 ? std::log(l) - std::log((1.0 - l) + std::exp(-logit))
                     : logit + std::log(l) - std::log1p((1.0 - l) * std::exp(logit));
}

// Gives a primitive the same share of its opacity throughout its part, with T in the middle.
void set_constant_opacity(double length, double l, std::size_t i, Gaussians4D& set) {
  set.opacity_logit[i] = static_cast<float>(logit_of_share(set.opacity_logit[i], l));
  set_time(0.5 * length, i, set);
  set.sigma[i] = 1.0f;
  set.radius[i] = static_cast<float>(length);
}

// Makes a primitive constant if it moves little in its part and hardly changes its opacity: static,
// at its position in the middle of the part, with its mean opacity.
void make_constant(double length, const LifespanBounds& bounds, std::size_t i, Gaussians4D& set) {
  const Lifespan life = lifespan_of(set, i);
  const double high = life.visibility(std::clamp(life.time, 0.0, length));
  const double low = life.visibility(life.time < 0.5 * length ? length : 0.0);
  float* u = &set.velocity[3 * i];
  const double way =
      length * std::sqrt(double{u[0]} * u[0] + double{u[1]} * u[1] + double{u[2]} * u[2]);
  // Averaging would blur a hard edge.
  const bool edge = life.sigma < kHardSigma && low < high;
  if (edge || life.opacity * (high - low) > 2.0 * bounds.opacity || way > bounds.motion) return;
  const double logit = set.opacity_logit[i];
  if (!(logit_of_share(logit, high) - logit_of_share(logit, low) <= 2.0 * bounds.logit)) return;
  set_constant_opacity(length, 0.5 * (high + low), i, set);
  std::fill_n(u, 3, 0.0f);
}

// Replaces a lifespan by one with the same visibility within its part and the smallest parameters.
void normalise(double length, std::size_t i, Gaussians4D& set) {
  const double time = set.time[i], radius = set.radius[i];
  if (time - radius <= 0.0 && time + radius >= length) {  // fully visible throughout the part
    set_time(0.5 * length, i, set);
    set.sigma[i] = 1.0f;
    set.radius[i] = static_cast<float>(length);
    return;
  }
  const FlatTop top = normalised_top({time, radius}, length);
  if (top.time == time) return;
  set_time(top.time, i, set);
  set.radius[i] = static_cast<float>(top.radius);
}

// Limits |T| to `reach`. A primitive that is visible from farther away hardly changes its opacity.
void limit_time(double length, double reach, std::size_t i, Gaussians4D& set) {
  if (std::abs(set.time[i]) <= reach) return;
  const Lifespan life = lifespan_of(set, i);
  set_constant_opacity(length, life.visibility(0.5 * length), i, set);
}

}  // namespace

double Lifespan::visibility(double t) const {
  return math::visibility(static_cast<float>(t - time), sigma, radius);
}

double Lifespan::fade() const {
  return math::support_half_width(opacity, sigma, 0.0f, math::kAlphaThreshold);
}

FlatTop normalised_top(FlatTop top, double length) {
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
      reach_(std::max(kReach * longest_part, kMinReach)) {
  if (reach_ >= std::ldexp(size_of(time_), kFineTimeBits)) {  // powers of two allow more bits
    const double octaves = std::ceil(std::log2(reach_)) - kTimeBits;
    time_ = coarser_of(step_near(time, 1), power_above(octaves));
  }
  const auto fits = [this](int halvings) {
    const Step step = finer_time(time_, halvings);
    return nearest(reach_, step) < max_steps(Mapping::kTime, step.multiplier) / 2;
  };
  while (finest_time_ < kMaxHalvings && fits(finest_time_ + 1)) ++finest_time_;
}

void LifespanGrids::snap(const TickRange& interval, std::size_t i, bool simplify,
                         Gaussians4D& set) const {
  const double length = length_of(interval);
  if (lifetime_of(set, i, length).never) return;
  if (simplify) {
    make_constant(length, bounds_, i, set);
    normalise(length, i, set);
  }
  limit_time(length, reach_, i, set);
  const Lifespan was = lifespan_of(set, i);
  float& logit = set.opacity_logit[i];
  logit = on_grid(std::clamp(logit, -bounds_.max_logit, bounds_.max_logit), opacity_);
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
                                const TickRange& interval) const {
  const FrameRange frames(interval);
  const double length = length_of(interval);
  const double bound = std::max(bounds_.edge * was.sigma, size_of(time_));
  for (int halved = 0; halved <= kMaxHalvings; ++halved) {
    const Step time = finer_time(time_, std::min(halved, finest_time_));
    if (was.sigma < kHardSigma) {
      const auto found =
          hard_edged(was, life, frames, bounds_.hard_edge, time, finer_lifespan(lifespan_, halved));
      if (found) return *found;
      continue;
    }
    for (int halvings = 0; halvings <= lifespan_.exponent - kMinLifespanStep; ++halvings) {
      const Step lifespan = finer_lifespan(lifespan_, halvings);
      if (const auto found = soft_edged(was, life, length, bound, time, lifespan)) return *found;
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
    while (lifespan_.exponent - radius > kMinLifespanStep &&
           on_lifespan_grid(r, finer_lifespan(lifespan_, radius)) != r) {
      ++radius;
    }
  }
  return {finer_time(time_, time), lifespan_, finer_lifespan(lifespan_, radius)};
}

}  // namespace stgs
