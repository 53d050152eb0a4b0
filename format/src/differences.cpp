// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/differences.h"

#include <algorithm>
#include <cmath>

#include "lifespans.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs {
namespace {

constexpr double kMostFrames = 64.0;  // of a fade that are looked at

// When something is seen at all, and fully, ticks of its part.
struct Moments {
  double begin, full_begin, full_end, end;
  bool never;
};

Moments moments_of(const Gaussians4D& set, std::size_t i) {
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
  const Moments seen = moments_of(a, i);
  if (seen.never) return 0.0;
  const double first = std::max(0.0, seen.begin), last = std::min(part_ticks, seen.end);
  if (first > last) return 0.0;
  double largest = 0.0;
  for (const double t : {first, last}) {  // both go straight: the difference is greatest at an end
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
  const Moments was = moments_of(a, i), is = moments_of(b, j);
  const double length = part.end - part.begin;
  if (was.never || was.end < 0.0 || was.begin > length) return out;
  const double first = std::ceil(part.begin) - part.begin;
  const double last = std::floor(part.end) - part.begin;
  // At the frames of a range of moments, not all of them where they are many.
  const auto compare = [&](double begin, double end) {
    begin = first + std::ceil(std::clamp(begin, first, last) - first);
    end = std::clamp(end, first, last);
    const double stride = std::max(1.0, std::ceil((end - begin) / kMostFrames));
    for (double t = begin; t <= end; t += stride) {
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
  const FlatTop x = brought_in({a.time[i], a.radius[i]}, length);
  const FlatTop y = brought_in({b.time[j], b.radius[j]}, length);
  out.time = std::abs(x.time - y.time);
  out.radius = std::abs(x.radius - y.radius);
  out.sigma = std::abs(std::log(double{a.sigma[i]} / b.sigma[j]));
  return out;
}

}  // namespace stgs
