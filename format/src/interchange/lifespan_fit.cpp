// SPDX-License-Identifier: Apache-2.0
#include "interchange/lifespan_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace stgs {
namespace {

constexpr int kSamples = 64;        // of a lifespan
constexpr std::size_t kNodes = 65;  // of the table of fits
constexpr double kReach = 2.4;      // sigmas after which a fade is below 1/255

double flat_top(double dt, double sigma, double radius) {
  const double beyond = std::max(0.0, std::abs(dt) - radius) / sigma;
  return std::exp(-beyond * beyond);
}

// The integral of the squared difference between a flat top and a Gaussian centred on it.
double integrated_error(double fitted, double sigma, double radius) {
  constexpr int kSteps = 512;
  const double end = std::max(radius + 4 * sigma, 4 * fitted), step = end / kSteps;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double dt = (i + 0.5) * step;
    const double d = flat_top(dt, sigma, radius) - flat_top(dt, fitted, 0);
    sum += d * d * step;
  }
  return sum;
}

double search_fit(double sigma, double radius) {
  const double golden = std::numbers::phi - 1;
  double low = 0.5 * (sigma + radius), high = 1.5 * (sigma + radius);
  for (int i = 0; i < 40; ++i) {
    const double a = high - golden * (high - low), b = low + golden * (high - low);
    if (integrated_error(a, sigma, radius) < integrated_error(b, sigma, radius)) {
      high = b;
    } else {
      low = a;
    }
  }
  return (low + high) / 2;
}

// fitted / (sigma + radius) for radius / (sigma + radius) = 0 to 1, in equal steps.
std::array<double, kNodes> make_table() {
  std::array<double, kNodes> table{};
  for (std::size_t i = 0; i < kNodes; ++i) {
    const double radius = std::min(0.9999, static_cast<double>(i) / (kNodes - 1));
    table[i] = i == 0 ? 1 : search_fit(1 - radius, radius);
  }
  return table;
}

// Measures the difference to the flat top.
template <typename Visibility>
void measure(LifespanFit& fit, const TickRange& range, double time, double sigma, double radius,
             const Visibility& visibility) {
  fit.ticks = range.end - range.begin;
  const double step = fit.ticks / kSamples;
  for (int i = 0; i < kSamples; ++i) {
    const double t = range.begin + (i + 0.5) * step;
    const double d = std::abs(flat_top(t - time, sigma, radius) - visibility(t));
    fit.error_max = std::max(fit.error_max, d);
    fit.error_squares += d * d * step;
  }
}

}  // namespace

double fitted_sigma(double sigma, double radius) {
  static const std::array<double, kNodes> table = make_table();
  const double width = sigma + radius, at = radius / width * (kNodes - 1);
  const auto node = std::min(static_cast<std::size_t>(at), kNodes - 2);
  const double share = at - static_cast<double>(node);
  return width * std::lerp(table[node], table[node + 1], share);
}

LifespanFit fit_lifespan(double time, double sigma, double radius, const TickRange& displayed) {
  LifespanFit fade;
  fade.begin = displayed.begin;
  fade.end = displayed.end;
  fade.time = time;
  fade.sigma = radius > 0 ? fitted_sigma(sigma, radius) : sigma;
  const double reach = std::max(radius + kReach * sigma, kReach * fade.sigma);
  const TickRange range = {std::max(displayed.begin, time - reach),
                           std::min(displayed.end, time + reach)};
  if (!(range.begin < range.end)) return fade;
  measure(fade, range, time, sigma, radius,
          [&](double t) { return flat_top(t - time, fade.sigma, 0); });

  const double half = radius + sigma * std::sqrt(std::numbers::ln2);
  LifespanFit edges = {};
  edges.never_fades = true;
  // Halfway between frames, so that few different windows are needed.
  edges.begin = std::max(displayed.begin, std::ceil(time - half) - 0.5);
  edges.end = std::min(displayed.end, std::floor(time + half) + 0.5);
  if (time - half <= displayed.begin) edges.begin = displayed.begin;
  if (time + half >= displayed.end - 1) edges.end = displayed.end;
  if (!(edges.begin < edges.end)) return fade;
  edges.time = (edges.begin + edges.end) / 2;
  edges.sigma = sigma;
  measure(edges, range, time, sigma, radius,
          [&](double t) { return t >= edges.begin && t < edges.end ? 1.0 : 0.0; });
  return edges.error_squares < fade.error_squares ? edges : fade;
}

}  // namespace stgs
