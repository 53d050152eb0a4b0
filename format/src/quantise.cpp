// SPDX-License-Identifier: Apache-2.0
#include "quantise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "axis_turns.h"
#include "stgs/format/math/blend.h"

namespace stgs {
namespace {

// Octaves of steps, 0 at kReference: 12.5 units of quality an octave below it and 6 above. Below
// kPoor pictures fall apart, so that there a unit does less.
constexpr double kReference = 85.0, kPoor = 55.0;
constexpr double kUnits = 12.5, kFinerUnits = 6.0, kPoorUnits = 25.0;
// Steps in octaves beyond which what they save costs more in pictures than it would anywhere else:
// of opacity (logit), T (ticks), log-scale, rotation, and the opacity that a constant may be off.
constexpr double kCoarsestOpacity = -0.5, kCoarsestTime = -0.5, kCoarsestLogScale = -0.75;
constexpr double kMostEvenOpacity = -3.5;
constexpr double kEvenOpacity = -5.0;  // octaves: opacity that a constant lifespan may be off
constexpr double kEdge = -2.0, kCoarsestEdge = -1.0;  // octaves: sigmas that an end may be off
// Powers of importance in steps, measured: less than the ideal 0.5. One that is guessed by size
// says less, least about positions: what is small needs its place as exactly as what is large.
constexpr double kPower = 0.3;
constexpr double kPowerBySize = 0.2, kPositionPowerBySize = 0.1;
constexpr double kMostOctaves = 3.0;  // that importance makes a step finer or coarser
// Steps as shares of a bound on where a primitive lies; each takes half of it. A position is off by
// half the diagonal of a step. A displacement too, over 2^E ticks of a life L < 2^(E+1) that is
// seen for at most 1.18 L from T on, where its opacity falls to 1/255 (spec 7.5.4).
constexpr double kPositionShare = 0.5 / 0.867;
constexpr double kDisplacementShare = 0.5 / (0.867 * 2.36);
// Of a displacement in steps, whose product with a multiplier stays below 2^23.
constexpr int kDisplacementBits = 22, kFineDisplacementBits = 19;
constexpr double kOutlier = 16.0;         // times what nine tenths do, that is far out
constexpr double kDistanceOctaves = 4.0;  // of what lies far out and shares a layout
constexpr int kMostDistances = 12;        // so that a segment's records have numbers (spec 5.7)
// Importance by size is bounded by this many times what nine tenths have: a dome of a sky covers a
// million times what a splat does, and would leave no steps for the mean.
constexpr float kMostImportance = 64.0f;
constexpr double kLeastRotation = -12.0, kMostRotation = -2.5;

// The least power of two in which numbers up to `largest` fit `bits` bits.
Step step_for(double largest, int bits) {
  return power_above(largest > 0.0 ? std::ceil(std::log2(largest)) - bits : kMinExponent);
}

// The value that so many hundredths of others lie below; 0 of none.
float percentile(std::vector<float> values, std::size_t hundredths) {
  if (values.empty()) return 0.0f;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() * hundredths / 100);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

struct Extent {
  std::array<float, 3> low{}, high{};
  double largest() const {
    double out = 0.0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      out = std::max(out, static_cast<double>(high[axis]) - low[axis]);
    }
    return out;
  }
};

// Of some primitives, or of all.
Extent extent_of(const Gaussians4D& set, const std::vector<std::uint32_t>* members) {
  Extent out;
  const std::size_t n = members != nullptr ? members->size() : set.size();
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t i = members != nullptr ? (*members)[k] : k;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float x = set.position[3 * i + axis];
      out.low[axis] = k == 0 ? x : std::min(out.low[axis], x);
      out.high[axis] = k == 0 ? x : std::max(out.high[axis], x);
    }
  }
  return out;
}

// By axis, so that what lies far out does not move it.
std::array<float, 3> median_of(const Gaussians4D& set) {
  std::array<float, 3> out{};
  std::vector<float> line(set.size());
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < line.size(); ++i) line[i] = set.position[3 * i + axis];
    out[axis] = percentile(line, 50);
  }
  return out;
}

// From a place, along the axis along which it is farthest; scene units.
double distance_from(const std::array<float, 3>& place, const Gaussians4D& set, std::size_t i) {
  double out = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    out = std::max(out, std::abs(double{set.position[3 * i + axis]} - place[axis]));
  }
  return out;
}

// The size that a position's error is measured against: a primitive smaller than three quarters of
// the set, as the mean of its log-scales.
double typical_log_scale(const Gaussians4D& set) {
  std::vector<float> sizes(set.size());
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const float* s = set.log_scale.data() + 3 * i;
    sizes[i] = (s[0] + s[1] + s[2]) / 3.0f;
  }
  return percentile(std::move(sizes), 25);
}

Integers begin(Attribute attribute, Mapping mapping, Step step, int components, std::size_t n) {
  Integers out;
  out.attribute = attribute;
  out.mapping = mapping;
  out.step = step;
  out.components = components;
  out.values.resize(n * static_cast<std::size_t>(components));
  return out;
}

// x in steps, so few that a mapping can sum two of these.
std::uint32_t steps_in(double x, Step step, Mapping mapping) {
  const std::int64_t most = max_steps(mapping, step.multiplier) / 2;
  return static_cast<std::uint32_t>(std::clamp(nearest(x, step), -most, most));
}

// Numbers of steps.
Integers linear(const Gaussians4D& part, Attribute attribute, Mapping mapping, Step step) {
  const int components = components_of(attribute);
  const std::size_t n = part.size();
  const AttributeView<const float> view = view_of(part, attribute);
  Integers out = begin(attribute, mapping, step, components, n);
  for (std::size_t c = 0; c < static_cast<std::size_t>(components); ++c) {
    for (std::size_t i = 0; i < n; ++i) {
      out.values[c * n + i] = steps_in(view.data[i * view.stride + c], step, mapping);
    }
  }
  return out;
}

// The same from the beginning of the segment on.
Integers moments(const Gaussians4D& part, Step step, double segment_begin) {
  Integers out = linear(part, Attribute::kTime, Mapping::kTime, step);
  const auto first = static_cast<std::uint32_t>(time_origin(segment_begin, step));
  for (std::uint32_t& v : out.values) v -= first;
  return out;
}

Integers truncated(const Gaussians4D& part, Attribute attribute, Step step, float offset) {
  const AttributeView<const float> view = view_of(part, attribute);
  Integers out = begin(attribute, Mapping::kTruncated, step, 1, part.size());
  for (std::size_t i = 0; i < part.size(); ++i) {
    out.values[i] = static_cast<std::uint32_t>(truncated_steps(view.data[i] + offset, step));
  }
  out.origin[1] = offset;
  return out;
}

Integers displacement(const Gaussians4D& part, Step step, float part_ticks) {
  const std::size_t n = part.size();
  Integers out = begin(Attribute::kVelocity, Mapping::kDisplacement, step, 3, n);
  for (std::size_t i = 0; i < n; ++i) {
    const int e = step.exponent - lifespan_exponent(part.sigma[i], part.radius[i], part_ticks);
    const Step own{std::clamp(e, kMinExponent, kMaxExponent), step.multiplier};
    for (std::size_t c = 0; c < 3; ++c) {
      out.values[c * n + i] = steps_in(part.velocity[3 * i + c], own, Mapping::kDisplacement);
    }
  }
  return out;
}

// `shapes`: the primitives with the log-scales that a decoder will see.
Integers rotation(const Gaussians4D& part, const std::vector<float>& shapes, Step step) {
  const std::size_t n = part.size();
  Integers out = begin(Attribute::kRotation, Mapping::kShapedRotation, step, 3, n);
  for (std::size_t i = 0; i < n; ++i) {
    const float* q = part.rotation.data() + 4 * i;
    const Step own{std::clamp(step.exponent + rotation_shift(shapes.data() + 3 * i),
                              kMinRotationExponent, kMaxRotationExponent),
                   step.multiplier};
    for (std::size_t c = 0; c < 3; ++c) {
      out.values[c * n + i] = static_cast<std::uint32_t>(nearest(q[c + 1], own));
    }
  }
  return out;
}

// The log-scales that a decoder makes of these integers.
std::vector<float> decoded_log_scales(const Integers& integers) {
  const std::size_t n = integers.values.size() / 3;
  std::vector<float> out(3 * n);
  const auto step = static_cast<float>(size_of(integers.step));
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < n; ++i) {
      const auto k = static_cast<std::int32_t>(integers.values[c * n + i]);
      out[3 * i + c] = step * static_cast<float>(k);
    }
  }
  return out;
}

// Luma and two chroma integers for each coefficient, zero-centred (spec 7.5.6).
Integers colour(const Gaussians4D& part, Attribute attribute, Step step) {
  const auto components = static_cast<std::size_t>(components_of(attribute));
  const std::size_t n = part.size();
  const AttributeView<const float> view = view_of(part, attribute);
  Integers out = begin(attribute, Mapping::kColour, step, static_cast<int>(components), n);
  for (std::size_t c = 0; c < components; c += 3) {
    for (std::size_t i = 0; i < n; ++i) {
      const float* channel = view.data + i * view.stride + c;
      const double r = channel[0], g = channel[1], b = channel[2];
      const double planes[3] = {0.25 * (r + 2.0 * g + b), 0.5 * (r - b), 0.25 * (2.0 * g - r - b)};
      for (std::size_t k = 0; k < 3; ++k) {
        out.values[(c + k) * n + i] = steps_in(planes[k], step, Mapping::kColour);
      }
    }
  }
  return out;
}

// Fills keys and the order of ascending keys.
Integers position(const Gaussians4D& part, const GroupSteps& steps,
                  std::vector<std::uint32_t>& order) {
  Integers out;
  out.attribute = Attribute::kPosition;
  out.mapping = Mapping::kLinear;
  out.components = 3;
  out.step = steps.position;
  std::copy_n(steps.origin, 3, out.origin);
  const std::size_t n = part.size();
  std::vector<std::uint64_t> keys(n);
  for (std::size_t i = 0; i < n; ++i) {
    std::array<std::uint32_t, 3> q{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double from_origin =
          static_cast<double>(part.position[3 * i + axis]) - out.origin[axis];
      q[axis] = static_cast<std::uint32_t>(
          std::clamp<std::int64_t>(nearest(from_origin, out.step), 0, (1 << kMortonBits) - 1));
    }
    keys[i] = morton_key(q[0], q[1], q[2]);
  }
  order.resize(n);
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&keys](std::uint32_t a, std::uint32_t b) {
    return keys[a] != keys[b] ? keys[a] < keys[b] : a < b;
  });
  for (std::uint32_t i : order) out.morton.push_back(keys[i]);
  return out;
}

// The greatest displacement of a component over a lifespan, scene units (spec 7.5.4).
double way_of(const Gaussians4D& set, std::size_t i, float part_ticks) {
  double out = 0.0;
  const int life = lifespan_exponent(set.sigma[i], set.radius[i], part_ticks);
  for (std::size_t c = 0; c < 3; ++c) {
    out = std::max(out, std::ldexp(std::abs(double{set.velocity[3 * i + c]}), life));
  }
  return out;
}

double farthest_way(const Gaussians4D& set, const std::vector<std::uint32_t>& members,
                    float part_ticks) {
  double out = 0.0;
  for (const std::uint32_t i : members) out = std::max(out, way_of(set, i, part_ticks));
  return out;
}

double octaves_coarser(double quality) {
  if (quality >= kReference) return (kReference - quality) / kFinerUnits;
  const double poor = std::max(0.0, kPoor - quality);
  return (kReference - quality - poor) / kUnits + poor / kPoorUnits;
}

double mean_of(std::span<const float> values) {
  double sum = 0.0;
  for (const float v : values) sum += v;
  return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

// So many times what nine tenths of the set do not exceed, of measure(i).
template <typename Measure>
double outlier_bound(const Gaussians4D& set, const Measure& measure) {
  std::vector<float> values(set.size());
  constexpr double kMost = std::numeric_limits<float>::max();
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<float>(std::min(measure(i), kMost));
  }
  return kOutlier * percentile(std::move(values), 90);
}

}  // namespace

Quantiser::Quantiser(const Gaussians4D& set, std::span<const float> importance, bool by_size,
                     double longest_part, double quality, double max_error)
    : longest_part_(static_cast<float>(longest_part)),
      max_error_(max_error),
      power_(by_size ? kPowerBySize : kPower),
      position_power_(by_size ? kPositionPowerBySize : kPower) {
  coarser_ = octaves_coarser(quality);
  importance_ = mean_of(importance);
  const double size = typical_log_scale(set) / std::log(2.0);
  // Measured at equal loss; where importance is a guess, colour is worth less against place.
  steps_.position = std::clamp(size - (by_size ? 3.3 : 3.1), -90.0, 90.0);
  steps_.displacement = steps_.position + 1.0;
  steps_.log_scale = -3.4;
  steps_.rotation = -5.2;
  steps_.sh[0] = by_size ? -4.35 : -4.65;
  steps_.sh[1] = steps_.sh[2] = steps_.sh[3] = by_size ? -4.6 : -4.9;
  steps_.opacity = step_near(std::min(-1.5 + coarser_, kCoarsestOpacity), kFineSteps);
  double still = std::exp2(steps_.displacement + coarser_);
  if (max_error_ > 0.0) still = std::min(still, max_error_);  // half of it either way
  // As far as steps reach, importance asking for finer ones by an octave; and where most are.
  middle_ = median_of(set);
  const Step place = bounded(steps_.position + coarser_, kPositionShare, kCoarseSteps);
  near_ = std::max(std::ldexp(size_of(place), kMortonBits - 2),
                   outlier_bound(set, [&](auto i) { return distance_from(middle_, set, i); }));
  const Step way = bounded(steps_.displacement + coarser_, kDisplacementShare, kFineSteps);
  near_way_ = std::max(std::ldexp(size_of(way), kFineDisplacementBits - 1),
                       outlier_bound(set, [&](auto i) { return way_of(set, i, longest_part_); }));
  lifespans_.emplace(
      longest_part, std::min(-2.0 + coarser_, kCoarsestTime),
      std::clamp(21.0 + coarser_, 16.0, 22.0), steps_.opacity,
      LifespanBounds{still, std::exp2(std::min(kEvenOpacity + coarser_, kMostEvenOpacity)),
                     std::exp2(std::min(kEdge + coarser_, kCoarsestEdge))});
}

Step Quantiser::bounded(double octaves, double share, int in_octave) const {
  const Step step = step_near(octaves, in_octave);
  if (max_error_ == 0.0) return step;
  const Step bound = step_below(std::log2(max_error_ * share), in_octave);
  return size_of(bound) < size_of(step) ? bound : step;
}

// Never so fine that what goes farthest has no number.
Step Quantiser::displacement_step(double octaves, double farthest) const {
  const Step step = bounded(octaves, kDisplacementShare, kFineSteps);
  if (size_of(step) >= size_of(step_for(farthest, kFineDisplacementBits))) return step;
  return coarser_of(bounded(octaves, kDisplacementShare, 1), step_for(farthest, kDisplacementBits));
}

Gaussians4D Quantiser::snap_lifespans(const Gaussians4D& set,
                                      std::span<const PartRange> parts) const {
  Gaussians4D out = set;
  for (const PartRange& part : parts) {
    for (std::uint32_t i = part.first; i < part.last; ++i) lifespans_->snap(part.interval, i, out);
  }
  return out;
}

int Quantiser::distance_of(const Gaussians4D& set, std::size_t i) const {
  const double farther =
      std::max(distance_from(middle_, set, i) / near_, way_of(set, i, longest_part_) / near_way_);
  if (farther <= 1.0) return 0;
  return std::min(1 + static_cast<int>(std::log2(farther) / kDistanceOctaves), kMostDistances);
}

GroupSteps Quantiser::steps_of(const Gaussians4D& set, const std::vector<std::uint32_t>& members,
                               double importance) const {
  const double ratio = importance > 0 && importance_ > 0 ? importance_ / importance : 1.0;
  const auto coarser_by = [&](double power) {
    return coarser_ + std::clamp(power * std::log2(ratio), -kMostOctaves, kMostOctaves);
  };
  const double coarser = coarser_by(power_);
  const auto fine = [coarser](double step) { return step_near(step + coarser, kFineSteps); };
  const Extent extent = extent_of(set, &members);
  GroupSteps out;
  out.lifespan = lifespans_->steps_of(set, members);
  // One value less than 2^21, because the origin is rounded down.
  out.position = coarser_of(
      bounded(steps_.position + coarser_by(position_power_), kPositionShare, kCoarseSteps),
      step_for(extent.largest() * 1.000001, kMortonBits));
  for (std::size_t axis = 0; axis < 3; ++axis)
    out.origin[axis] = on_grid(extent.low[axis], out.position);
  out.displacement =
      displacement_step(steps_.displacement + coarser, farthest_way(set, members, longest_part_));
  out.log_scale = step_near(std::min(steps_.log_scale + coarser, kCoarsestLogScale), kFineSteps);
  out.rotation =
      step_near(std::clamp(steps_.rotation + coarser, kLeastRotation, kMostRotation), kCoarseSteps);
  for (int band = 0; band < 4; ++band) out.sh[band] = fine(steps_.sh[band]);
  return out;
}

std::vector<Integers> Quantiser::quantise(const Gaussians4D& part, const GroupSteps& steps,
                                          double segment_begin, float part_ticks,
                                          std::vector<std::uint32_t>& order) const {
  std::vector<Integers> out;
  out.push_back(position(part, steps, order));
  Gaussians4D sorted = part.gather(order);
  least_rotations(sorted);
  out.push_back(moments(sorted, steps.lifespan.time, segment_begin));
  out.push_back(truncated(sorted, Attribute::kSigma, steps.lifespan.sigma, 0.0f));
  out.push_back(truncated(sorted, Attribute::kRadius, steps.lifespan.radius, 1.0f));
  out.push_back(displacement(sorted, steps.displacement, part_ticks));
  out.push_back(linear(sorted, Attribute::kLogScale, Mapping::kLinear, steps.log_scale));
  out.push_back(rotation(sorted, decoded_log_scales(out.back()), steps.rotation));
  out.push_back(linear(sorted, Attribute::kOpacity, Mapping::kLinear, steps_.opacity));
  for (int band = 0; band <= part.sh_degree; ++band) {
    const auto attribute = static_cast<Attribute>(static_cast<int>(Attribute::kSh0) + band);
    out.push_back(colour(sorted, attribute, steps.sh[band]));
  }
  return out;
}

float Quantiser::position_step(const Gaussians4D& set) const {
  const Step widest = step_for(extent_of(set, nullptr).largest() * 1.000001, kMortonBits);
  const double coarsest = std::ceil(steps_.position + coarser_ + kMostOctaves);
  return static_cast<float>(size_of(coarser_of(power_above(coarsest), widest)));
}

std::vector<float> importance_by_size(const Gaussians4D& set, double ticks) {
  std::vector<float> out(set.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const float* s = set.log_scale.data() + 3 * i;
    const float area = std::min(std::exp(s[0] + s[1] + s[2] - std::min({s[0], s[1], s[2]})),
                                std::numeric_limits<float>::max());
    const float opacity = math::opacity_of(set.opacity_logit[i]);
    const float span = set.radius[i] + set.sigma[i];
    out[i] = opacity * opacity * area * std::min(1.0f, 2.0f * span / static_cast<float>(ticks));
  }
  const float most = kMostImportance * percentile(out, 90);
  if (most > 0.0f) {
    for (float& x : out) x = std::min(x, most);
  }
  return out;
}

}  // namespace stgs
