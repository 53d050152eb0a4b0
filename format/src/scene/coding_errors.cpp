// SPDX-License-Identifier: Apache-2.0
#include "scene/coding_errors.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "codec/sh_members.h"
#include "quantise/axis_turns.h"
#include "quantise/lifespans.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs {
namespace {

// Returns the smallest float not below x, which is finite and at least 0.
float rounded_up(double x) {
  constexpr float kMax = std::numeric_limits<float>::max();
  const auto out = static_cast<float>(std::min<double>(x, kMax));
  return double{out} < x && out < kMax ? std::nextafter(out, kMax) : out;
}

double length_of(const std::array<double, 3>& v) {
  return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

// Returns the distance of coded primitive k, at its T, from the trajectory of its source.
double distance_of(const Gaussians4D& source, std::size_t i, const Gaussians4D& coded,
                   std::size_t k) {
  const double dt = double{coded.time[k]} - source.time[i];
  std::array<double, 3> d{};
  for (std::size_t c = 0; c < 3; ++c) {
    const double x = source.position[3 * i + c] + source.velocity[3 * i + c] * dt;
    d[c] = x - coded.position[3 * k + c];
  }
  return length_of(d);
}

double velocity_error(const Gaussians4D& source, std::size_t i, const Gaussians4D& coded,
                      std::size_t k) {
  std::array<double, 3> d{};
  for (std::size_t c = 0; c < 3; ++c)
    d[c] = double{source.velocity[3 * i + c]} - coded.velocity[3 * k + c];
  return length_of(d);
}

// Returns the logit of the greatest opacity that a primitive has in its part.
double greatest_opacity(const Gaussians4D& set, std::size_t i, double part_ticks) {
  const double from_centre = std::clamp(double{set.time[i]}, 0.0, part_ticks) - set.time[i];
  const float l = math::visibility(static_cast<float>(from_centre), set.sigma[i], set.radius[i]);
  const double opacity = double{math::opacity_of(set.opacity_logit[i])} * l;
  if (l == 1.0f || !(opacity > 0.0)) return set.opacity_logit[i];
  return std::log(opacity / (1.0 - opacity));
}

}  // namespace

Gaussians4D map_planes(std::span<const RecordPlanes> planes, std::span<const StreamPlan> plans,
                       int sh_degree, double segment_begin, int part_exponent) {
  const std::size_t n = planes.front().n;
  SegmentContext context;
  context.part_exponent = part_exponent;
  context.begin = segment_begin;
  context.first_key = planes.front().first_key;
  ShMembers members;
  std::vector<std::vector<Plane>> of_streams(plans.size());
  std::vector<StreamTask> tasks;
  const std::size_t base = planes.size() == 1 ? plans.size() : streams_of(0).size();
  const std::uint8_t* at = nullptr;
  for (std::size_t a = 0; a < plans.size(); ++a) {
    const RecordPlanes& record = planes[a < base ? 0 : 1];
    if (a == 0 || a == base) at = record.symbols.data();
    const StreamRow& row = plans[a].row;
    const auto attribute = static_cast<Attribute>(row.attribute);
    const std::size_t symbols = record.symbols_of(attribute);
    for (std::size_t p = 0; p < row.planes(); ++p, at += symbols) of_streams[a].push_back({at, 0});
    if (attribute == Attribute::kShDegree)
      members = ShDegrees(row, of_streams[a], static_cast<std::uint32_t>(record.n)).members();
    if (attribute == Attribute::kLogScale) context.shape_bounds = shape_bounds(row.step);
    if (attribute == Attribute::kShDegree || symbols == 0) continue;
    tasks.push_back({&row, of_streams[a].data(), {}});
    if (symbols < n)
      tasks.back().members = members[static_cast<std::size_t>(band_of(attribute)) - 1];
  }
  Gaussians4D out;
  out.sh_degree = sh_degree;
  out.resize(n);
  map_streams(tasks, context, n, out);
  return out;
}

void CodingErrors::Sum::add(double error) {
  greatest = std::max(greatest, error);
  squares += error * error;
  count += 1;
}

void CodingErrors::add_lifespan(const Gaussians4D& source, std::size_t i, const Gaussians4D& coded,
                                std::size_t k, double part_ticks) {
  const double time = coded.time[k], radius = coded.radius[k];
  const bool constant = time - radius <= 0.0 && time + radius >= part_ticks;
  const FlatTop was = normalised_top({source.time[i], source.radius[i]}, part_ticks);
  const FlatTop is = normalised_top({time, radius}, part_ticks);
  sum_of(Attribute::kTime).add(constant ? 0.0 : std::abs(was.time - is.time));
  sum_of(Attribute::kRadius).add(constant ? 0.0 : std::abs(was.radius - is.radius));
  sum_of(Attribute::kSigma)
      .add(constant ? 0.0 : std::abs(double{source.sigma[i]} - coded.sigma[k]));
  const double logit =
      constant ? greatest_opacity(source, i, part_ticks) : double{source.opacity_logit[i]};
  sum_of(Attribute::kOpacity).add(std::abs(logit - coded.opacity_logit[k]));
}

void CodingErrors::add(const Gaussians4D& source, std::span<const std::uint32_t> members,
                       const Gaussians4D& coded, double part_ticks) {
  for (std::size_t k = 0; k < members.size(); ++k) {
    const std::size_t i = members[k];
    sum_of(Attribute::kPosition).add(distance_of(source, i, coded, k));
    sum_of(Attribute::kVelocity).add(velocity_error(source, i, coded, k));
    const ShapeDifference shape = shape_difference(source, i, coded, k);
    sum_of(Attribute::kRotation).add(shape.angle);
    for (const double d : shape.log_scales) sum_of(Attribute::kLogScale).add(d);
    add_lifespan(source, i, coded, k, part_ticks);
  }
  add_sh(source, members, coded);
}

void CodingErrors::add_sh(const Gaussians4D& source, std::span<const std::uint32_t> members,
                          const Gaussians4D& coded) {
  constexpr std::size_t kEnd[] = {3, 12, 27, 48};  // of the numbers of a degree
  const std::size_t stride = 3 * static_cast<std::size_t>(source.sh_coefficients());
  // By number, which the compiler vectorises.
  std::array<float, 48> greatest{};
  std::array<double, 48> squares{};
  for (std::size_t k = 0; k < members.size(); ++k) {
    const float* const was = source.sh.data() + members[k] * stride;
    const float* const is = coded.sh.data() + k * stride;
    for (std::size_t c = 0; c < stride; ++c) {
      const float d = std::abs(was[c] - is[c]);
      greatest[c] = greatest[c] < d ? d : greatest[c];
      squares[c] += double{d} * d;
    }
  }
  for (std::size_t c = 0, degree = 0; c < stride; ++c) {
    if (c == kEnd[degree]) ++degree;
    Sum& sum = sums_[degree == 0 ? static_cast<std::size_t>(Attribute::kSh0)
                                 : static_cast<std::size_t>(Attribute::kSh1) + degree - 1];
    sum.greatest = std::max<double>(sum.greatest, greatest[c]);
    sum.squares += squares[c];
    sum.count += static_cast<double>(members.size());
  }
}

void CodingErrors::add(const CodingErrors& other) {
  for (std::size_t a = 0; a < sums_.size(); ++a) {
    sums_[a].greatest = std::max(sums_[a].greatest, other.sums_[a].greatest);
    sums_[a].squares += other.sums_[a].squares;
    sums_[a].count += other.sums_[a].count;
  }
}

std::vector<ErrorBound> CodingErrors::bounds(int sh_degree) const {
  std::vector<ErrorBound> out;
  for (const Attribute attribute : attributes_of(sh_degree)) {
    const Sum& sum = sums_[static_cast<std::size_t>(attribute)];
    const double rms = std::sqrt(sum.squares / std::max(1.0, sum.count));
    out.push_back({attribute, rounded_up(sum.greatest), rounded_up(rms)});
  }
  return out;
}

}  // namespace stgs
