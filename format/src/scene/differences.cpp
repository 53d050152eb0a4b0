// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/differences.h"

#include <algorithm>
#include <cmath>

#include "quantise/lifespans.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs {
namespace {

constexpr double kMaxSampledFrames = 64.0;  // of a fade

// The ticks of its part at which a primitive is visible, and fully visible.
struct VisibleTicks {
  double begin, full_begin, full_end, end;
  bool never;
};

VisibleTicks visible_ticks_of(const Gaussians4D& set, std::size_t i) {
  const double half = math::support_half_width(math::opacity_of(set.opacity_logit[i]), set.sigma[i],
                                               set.radius[i], math::kAlphaThreshold);
  const double time = set.time[i], radius = set.radius[i];
  return {time - half, time - radius, time + radius, time + half, half < 0.0};
}

double opacity_at(const Gaussians4D& set, std::size_t i, double t) {
  const auto dt = static_cast<float>(t - set.time[i]);
  return double{math::opacity_of(set.opacity_logit[i])} *
         math::visibility(dt, set.sigma[i], set.radius[i]);
}

}  // namespace

double trajectory_error(const Gaussians4D& a, std::size_t i, const Gaussians4D& b, std::size_t j,
                        double part_ticks) {
  const VisibleTicks visible = visible_ticks_of(a, i);
  if (visible.never) return 0.0;
  const double first = std::max(0.0, visible.begin), last = std::min(part_ticks, visible.end);
  if (first > last) return 0.0;
  double largest = 0.0;
  for (const double t : {first, last}) {  // both are linear: the maximum is at an end
    double squared = 0.0;
    for (std::size_t c = 0; c < 3; ++c) {
      const double x = a.position[3 * i + c] + a.velocity[3 * i + c] * (t - a.time[i]);
      const double y = b.position[3 * j + c] + b.velocity[3 * j + c] * (t - b.time[j]);
      squared += (x - y) * (x - y);
    }
    largest = std::max(largest, squared);
  }
  return std::sqrt(largest);
}

LifespanError lifespan_error(const Gaussians4D& a, std::size_t i, const Gaussians4D& b,
                             std::size_t j, const TickRange& part) {
  LifespanError out;
  const VisibleTicks was = visible_ticks_of(a, i), is = visible_ticks_of(b, j);
  const double length = part.end - part.begin;
  if (was.never || was.end < 0.0 || was.begin > length) return out;
  const double first = std::ceil(part.begin) - part.begin;
  const double last = std::floor(part.end) - part.begin;
  // Compares at the frames of a range of times, or a sample of them if they are many.
  const auto compare = [&](double begin, double end) {
    begin = first + std::ceil(std::clamp(begin, first, last) - first);
    end = std::clamp(end, first, last);
    const double stride = std::max(1.0, std::ceil((end - begin) / kMaxSampledFrames));
    const double strides = std::floor((end - begin) / stride);
    for (int k = 0; k <= strides; ++k) {
      const double t = begin + k * stride;
      const double error = std::abs(opacity_at(a, i, t) - opacity_at(b, j, t));
      out.visibility = std::max(out.visibility, error);
    }
  };
  const double begin = is.never ? was.begin : std::min(was.begin, is.begin);
  const double end = is.never ? was.end : std::max(was.end, is.end);
  const double full_begin = std::max(was.full_begin, is.full_begin);
  const double full_end = std::min(was.full_end, is.full_end);
  if (full_begin < full_end) {
    compare(begin, full_begin + 1.0);
    compare(full_end - 1.0, end);
  } else {
    compare(begin, end);
  }
  if (is.full_begin <= 0.0 && is.full_end >= length) return out;
  const FlatTop x = normalised_top({a.time[i], a.radius[i]}, length);
  const FlatTop y = normalised_top({b.time[j], b.radius[j]}, length);
  out.time = std::abs(x.time - y.time);
  out.radius = std::abs(x.radius - y.radius);
  out.sigma = std::abs(std::log(double{a.sigma[i]} / b.sigma[j]));
  return out;
}

}  // namespace stgs
