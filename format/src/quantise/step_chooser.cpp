// SPDX-License-Identifier: Apache-2.0
#include "quantise/step_chooser.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "codec/stream.h"
#include "quantise/extents.h"

namespace stgs {
namespace {

// Quality to octaves of step size, 0 at kReference: 12.5 units of quality per octave below it, and
// 6 above. Below kPoor images fall apart, so that a unit has less effect.
constexpr double kReference = 85.0, kPoor = 55.0;
constexpr double kUnits = 12.5, kFinerUnits = 6.0, kPoorUnits = 25.0;
// Coarsest steps, in octaves: opacity (logit), T (ticks), log scale. Coarser ones would cost more
// image quality than the same bytes saved elsewhere. Likewise the greatest error of a constant
// opacity.
constexpr double kCoarsestOpacity = -0.5, kCoarsestTime = -0.5, kCoarsestLogScale = -0.75;
constexpr double kMaxConstantOpacity = -3.5;
constexpr double kConstantOpacity = -5.0;             // error of a constant opacity, octaves
constexpr double kEdge = -2.0, kCoarsestEdge = -1.0;  // error of an edge in sigmas, octaves
// Exponents of importance in steps, measured; lower than the ideal 0.5. An estimate by size is less
// reliable, in particular for positions: small primitives need them as exactly as large ones.
constexpr double kPower = 0.3;
constexpr double kPowerBySize = 0.2, kPositionPowerBySize = 0.1;
constexpr double kMaxOctaves = 3.0;       // greatest effect of importance on a step
constexpr std::size_t kTypicalSize = 25;  // the percentile
constexpr double kOutlier = 16.0;         // multiple of the 90th percentile beyond which one is far
constexpr double kMinRotationStep = -12.0, kMaxRotationStep = -2.5;
// Near-lossless steps, in octaves. Measured: no attribute has much more effect on renders than the
// others; an octave costs 0.4 bytes per primitive (SH: 6). The unit of the position is the size of
// a small primitive: the kSmallSize-th percentile.
constexpr std::size_t kSmallSize = 5;
constexpr double kMinPosition = -90.0;  // scene units, within the range of exponents
constexpr double kFinePosition = -8.0, kFineLogScale = -8.0, kFineRotation = -10.0;
constexpr double kFineOpacity = -7.0, kFineSh = -9.0;             // logit, SH coefficients
constexpr double kFineTime = -8.0, kFineLifespan = 13.0;          // ticks, units in the last place
constexpr double kFineConstantOpacity = -10.0, kFineEdge = -7.0;  // as above
// Bits of a displacement within near_displacement, in steps.
constexpr int kNearDisplacementBits = 18;

// Returns the median position per axis, which outliers do not affect.
std::array<float, 3> median_of(const Gaussians4D& set) {
  std::array<float, 3> out{};
  std::vector<float> line(set.size());
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < line.size(); ++i) line[i] = set.position[3 * i + axis];
    out[axis] = percentile(line, 50);
  }
  return out;
}

// Returns the size relative to which position errors are measured, log2 of scene units: a
// percentile of the mean log scales, within the range of steps.
double typical_size(const Gaussians4D& set, std::size_t hundredths) {
  std::vector<float> sizes(set.size());
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const float* s = set.log_scale.data() + 3 * i;
    sizes[i] = (s[0] + s[1] + s[2]) / 3.0f;
  }
  return percentile(std::move(sizes), hundredths) / std::log(2.0);
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

// Returns kOutlier times the 90th percentile of measure(i).
template <typename Measure>
double outlier_bound(const Gaussians4D& set, const Measure& measure) {
  std::vector<float> values(set.size());
  constexpr double kMax = std::numeric_limits<float>::max();
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<float>(std::min(measure(i), kMax));
  }
  return kOutlier * percentile(std::move(values), 90);
}

}  // namespace

StepChooser::StepChooser(const Gaussians4D& set, std::span<const float> importance, bool by_size,
                         double longest_part, const StepGoal& goal)
    : importance_(mean_of(importance)) {
  rules_.max_error = goal.max_error;
  rules_.longest_part = longest_part;
  rules_.near_lossless = goal.near_lossless;
  rules_.quality = goal.near_lossless ? 0.0 : goal.quality;
  if (goal.near_lossless) {
    choose_near_lossless(set);
  } else {
    choose_by_quality(set, by_size);
  }
  limit_outliers(set);
}

void StepChooser::choose_by_quality(const Gaussians4D& set, bool by_size) {
  power_ = by_size ? kPowerBySize : kPower;
  position_power_ = by_size ? kPositionPowerBySize : kPower;
  coarser_ = octaves_coarser(rules_.quality);
  // Measured at equal loss. With estimated importance, colour counts less relative to position.
  octaves_.position = std::clamp(typical_size(set, kTypicalSize) - (by_size ? 3.3 : 3.1),
                                 kMinPosition, -kMinPosition);
  octaves_.displacement = octaves_.position + 0.8;
  octaves_.log_scale = -3.4;
  octaves_.rotation = -5.2;
  octaves_.sh[0] = by_size ? -4.35 : -4.65;
  octaves_.sh[1] = octaves_.sh[2] = octaves_.sh[3] = by_size ? -4.6 : -4.9;
  rules_.opacity = step_near(std::min(-1.5 + coarser_, kCoarsestOpacity), kFineSteps);
  double motion = std::exp2(octaves_.displacement + coarser_);
  if (rules_.max_error > 0.0)
    motion = std::min(motion, rules_.max_error);  // half of it in each direction
  rules_.lifespans = {std::min(-2.0 + coarser_, kCoarsestTime),
                      std::clamp(21.0 + coarser_, 16.0, 22.0), motion,
                      std::exp2(std::min(kConstantOpacity + coarser_, kMaxConstantOpacity)),
                      std::exp2(std::min(kEdge + coarser_, kCoarsestEdge))};
}

void StepChooser::choose_near_lossless(const Gaussians4D& set) {
  octaves_.position =
      std::clamp(typical_size(set, kSmallSize) + kFinePosition, kMinPosition, -kMinPosition);
  octaves_.displacement = octaves_.position;
  octaves_.log_scale = kFineLogScale;
  octaves_.rotation = kFineRotation;
  std::fill(std::begin(octaves_.sh), std::end(octaves_.sh), kFineSh);
  rules_.opacity = step_near(kFineOpacity, 1);
  double motion = std::exp2(octaves_.position);
  if (rules_.max_error > 0.0) motion = std::min(motion, 0.5 * rules_.max_error);
  rules_.lifespans = {kFineTime, kFineLifespan, motion, std::exp2(kFineConstantOpacity),
                      std::exp2(kFineEdge)};
}

void StepChooser::limit_outliers(const Gaussians4D& set) {
  // The range of the steps, an octave of which is reserved for importance, and the bulk of the
  // primitives.
  rules_.middle = median_of(set);
  rules_.near_distance =
      std::max(std::ldexp(size_of(position_step(octaves_.position + coarser_)),
                          position_bits(rules_.near_lossless) - 2),
               outlier_bound(set, [&](auto i) { return distance_from(rules_.middle, set, i); }));
  const int longest = part_exponent_of(rules_.longest_part);
  rules_.near_displacement =
      std::max(std::ldexp(size_of(displacement_step(octaves_.displacement + coarser_)),
                          kNearDisplacementBits),
               outlier_bound(set, [&](auto i) { return displacement_of(set, i, longest); }));
}

Step StepChooser::position_step(double octaves) const {
  return bounded(octaves, rules_.max_error, kPositionShare,
                 rules_.near_lossless ? 1 : kCoarseSteps);
}

Step StepChooser::displacement_step(double octaves) const {
  return bounded(octaves, rules_.max_error, kDisplacementShare, kFineSteps);
}

TierSteps StepChooser::steps_for(double importance) const {
  const double ratio = importance > 0 && importance_ > 0 ? importance_ / importance : 1.0;
  const auto coarser_by = [&](double power) {
    return coarser_ + std::clamp(power * std::log2(ratio), -kMaxOctaves, kMaxOctaves);
  };
  const double coarser = coarser_by(power_);
  TierSteps out;
  out.position = position_step(octaves_.position + coarser_by(position_power_));
  out.displacement = displacement_step(octaves_.displacement + coarser);
  out.log_scale = step_near(std::min(octaves_.log_scale + coarser, kCoarsestLogScale), kFineSteps);
  out.rotation = step_near(
      std::clamp(octaves_.rotation + coarser, kMinRotationStep, kMaxRotationStep), kCoarseSteps);
  for (std::size_t band = 0; band < 4; ++band)
    out.sh[band] = step_near(octaves_.sh[band] + coarser, kFineSteps);
  return out;
}

void set_tiers(const StepChooser& chooser, const TierPlan& plan, std::span<const float> importance,
               Quantisation& quantisation) {
  quantisation.bounds = plan.bounds;
  quantisation.graded = plan.graded;
  std::vector<double> sums(plan.bounds.size() + 1, 0.0), counts(sums.size(), 0.0);
  for (const float x : importance) {
    const auto t = static_cast<std::size_t>(quantisation.tier_of(x));
    sums[t] += x;
    ++counts[t];
  }
  quantisation.tiers.clear();
  for (std::size_t t = 0; t < sums.size(); ++t) {
    quantisation.tiers.push_back(chooser.steps_for(counts[t] > 0 ? sums[t] / counts[t] : 0.0));
  }
}

}  // namespace stgs
