// SPDX-License-Identifier: Apache-2.0
#include "quantise/quantise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "quantise/axis_turns.h"
#include "quantise/integers.h"
#include "stgs/format/math/blend.h"

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
constexpr double kMaxOctaves = 3.0;  // greatest effect of importance on a step
// Steps as shares of max_error; position and displacement may each use half of it. The error of a
// position is half the diagonal of a step. So is that of a displacement, over 2^E ticks. With M <
// 2^(E+1) the greater of 2 sigma and r + 1 (spec 8.6), a primitive is visible for at most r + 2.36
// sigma < 2.18 M after T, where its opacity falls to 1/255.
constexpr double kPositionShare = 0.5 / 0.867;
constexpr double kDisplacementShare = 0.5 / (0.867 * 4.36);
// Bits of a displacement in steps: its product with a multiplier stays below 2^23.
constexpr int kDisplacementBits = 22, kFineDisplacementBits = 19;
constexpr double kOutlier = 16.0;         // multiple of the 90th percentile beyond which one is far
constexpr double kDistanceOctaves = 4.0;  // range of outliers that share a layout
constexpr int kMaxDistances = 12;         // limits the tiers of a segment (spec 5.7)
// Bound of the importance by size, as a multiple of the 90th percentile. A sky dome covers a
// million times the area of a splat and would dominate the mean.
constexpr float kMaxImportance = 64.0f;
constexpr double kTrainedSh = 1.0;  // octaves by which SH steps are coarser if trained for them
constexpr double kMinRotationStep = -12.0, kMaxRotationStep = -2.5;

// Returns the smallest power of two with which numbers up to `largest` fit into `bits` bits.
Step step_for(double largest, int bits) {
  return power_above(largest > 0.0 ? std::ceil(std::log2(largest)) - bits : kMinExponent);
}

// Returns a percentile; 0 if there are no values.
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

// Returns the extent of the members; of all primitives if null.
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

// Returns the distance of a primitive from a point along the axis with the greatest one; scene
// units.
double distance_from(const std::array<float, 3>& point, const Gaussians4D& set, std::size_t i) {
  double out = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    out = std::max(out, std::abs(double{set.position[3 * i + axis]} - point[axis]));
  }
  return out;
}

// Returns the size relative to which position errors are measured: the 25th percentile of the mean
// log scales.
double typical_log_scale(const Gaussians4D& set) {
  std::vector<float> sizes(set.size());
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const float* s = set.log_scale.data() + 3 * i;
    sizes[i] = (s[0] + s[1] + s[2]) / 3.0f;
  }
  return percentile(std::move(sizes), 25);
}

// Returns the greatest displacement along an axis over a lifespan, scene units (spec 8.6).
double displacement_of(const Gaussians4D& set, std::size_t i, int part_exponent) {
  double out = 0.0;
  const int life = lifespan_exponent_of(set.sigma[i], set.radius[i], part_exponent);
  for (std::size_t c = 0; c < 3; ++c) {
    out = std::max(out, std::ldexp(std::abs(double{set.velocity[3 * i + c]}), life));
  }
  return out;
}

double max_displacement(const Gaussians4D& set, const std::vector<std::uint32_t>& members,
                        int part_exponent) {
  double out = 0.0;
  for (const std::uint32_t i : members) out = std::max(out, displacement_of(set, i, part_exponent));
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

// Returns a step near 2^octaves that is at most this share of a bound, if there is one.
Step bounded(double octaves, double bound, double share, int in_octave) {
  const Step step = step_near(octaves, in_octave);
  if (bound == 0.0) return step;
  const Step largest = step_below(std::log2(bound * share), in_octave);
  return size_of(largest) < size_of(step) ? largest : step;
}

}  // namespace

StepChooser::StepChooser(const Gaussians4D& set, std::span<const float> importance, bool by_size,
                         double longest_part, double quality, double max_error)
    : power_(by_size ? kPowerBySize : kPower),
      position_power_(by_size ? kPositionPowerBySize : kPower),
      coarser_(octaves_coarser(quality)),
      importance_(mean_of(importance)) {
  rules_.quality = quality;
  rules_.max_error = max_error;
  rules_.longest_part = longest_part;
  const double size = typical_log_scale(set) / std::log(2.0);
  // Measured at equal loss. With estimated importance, colour counts less relative to position.
  octaves_.position = std::clamp(size - (by_size ? 3.3 : 3.1), -90.0, 90.0);
  octaves_.displacement = octaves_.position + 0.8;
  octaves_.log_scale = -3.4;
  octaves_.rotation = -5.2;
  octaves_.sh[0] = by_size ? -4.35 : -4.65;
  octaves_.sh[1] = octaves_.sh[2] = octaves_.sh[3] = by_size ? -4.6 : -4.9;
  rules_.opacity = step_near(std::min(-1.5 + coarser_, kCoarsestOpacity), kFineSteps);
  double motion = std::exp2(octaves_.displacement + coarser_);
  if (max_error > 0.0) motion = std::min(motion, max_error);  // half of it in each direction
  rules_.lifespans = {std::min(-2.0 + coarser_, kCoarsestTime),
                      std::clamp(21.0 + coarser_, 16.0, 22.0), motion,
                      std::exp2(std::min(kConstantOpacity + coarser_, kMaxConstantOpacity)),
                      std::exp2(std::min(kEdge + coarser_, kCoarsestEdge))};
  // Limits of outliers: the range of the steps, an octave of which is reserved for importance, and
  // the bulk of the primitives.
  rules_.middle = median_of(set);
  const Step position =
      bounded(octaves_.position + coarser_, max_error, kPositionShare, kCoarseSteps);
  rules_.near_distance =
      std::max(std::ldexp(size_of(position), kPositionBits - 2),
               outlier_bound(set, [&](auto i) { return distance_from(rules_.middle, set, i); }));
  const Step displacement =
      bounded(octaves_.displacement + coarser_, max_error, kDisplacementShare, kFineSteps);
  const int longest = part_exponent_of(longest_part);
  rules_.near_displacement =
      std::max(std::ldexp(size_of(displacement), kFineDisplacementBits - 1),
               outlier_bound(set, [&](auto i) { return displacement_of(set, i, longest); }));
}

TierSteps StepChooser::steps_for(double importance) const {
  const double ratio = importance > 0 && importance_ > 0 ? importance_ / importance : 1.0;
  const auto coarser_by = [&](double power) {
    return coarser_ + std::clamp(power * std::log2(ratio), -kMaxOctaves, kMaxOctaves);
  };
  const double coarser = coarser_by(power_), max_error = rules_.max_error;
  TierSteps out;
  out.position = bounded(octaves_.position + coarser_by(position_power_), max_error, kPositionShare,
                         kCoarseSteps);
  out.displacement =
      bounded(octaves_.displacement + coarser, max_error, kDisplacementShare, kFineSteps);
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

Quantiser::Quantiser(const Quantisation& rules)
    : rules_(rules),
      lifespans_(rules.longest_part, rules.lifespans.time, rules.lifespans.lifespan, rules.opacity,
                 {rules.lifespans.motion, rules.lifespans.opacity, rules.lifespans.edge}) {}

Step Quantiser::displacement_step(Step step, double farthest) const {
  if (size_of(step) >= size_of(step_for(farthest, kFineDisplacementBits))) return step;
  return coarser_of(bounded(std::log2(size_of(step)), rules_.max_error, kDisplacementShare, 1),
                    step_for(farthest, kDisplacementBits));
}

Gaussians4D Quantiser::snap_lifespans(const Gaussians4D& set, std::span<const PartRange> parts,
                                      bool simplify) const {
  Gaussians4D out = set;
  for (const PartRange& part : parts) {
    for (std::uint32_t i = part.first; i < part.last; ++i)
      lifespans_.snap(part.interval, i, simplify, out);
  }
  return out;
}

int Quantiser::distance_of(const Gaussians4D& set, std::size_t i) const {
  const int longest = part_exponent_of(rules_.longest_part);
  const double farther = std::max(distance_from(rules_.middle, set, i) / rules_.near_distance,
                                  displacement_of(set, i, longest) / rules_.near_displacement);
  if (farther <= 1.0) return 0;
  return std::min(1 + static_cast<int>(std::log2(farther) / kDistanceOctaves), kMaxDistances);
}

GroupSteps Quantiser::steps_of(const Gaussians4D& set, const std::vector<std::uint32_t>& members,
                               int tier) const {
  const TierSteps& steps = rules_.tiers[static_cast<std::size_t>(tier)];
  const Extent extent = extent_of(set, &members);
  const int longest = part_exponent_of(rules_.longest_part);
  GroupSteps out;
  out.lifespan = lifespans_.steps_of(set, members);
  // One value fewer than 2^21, because the origin is rounded down.
  out.position = coarser_of(steps.position, step_for(extent.largest() * 1.000001, kPositionBits));
  for (std::size_t axis = 0; axis < 3; ++axis)
    out.origin[axis] = on_grid(extent.low[axis], out.position);
  out.displacement = displacement_step(steps.displacement, max_displacement(set, members, longest));
  out.log_scale = steps.log_scale;
  out.rotation = steps.rotation;
  std::copy(steps.sh.begin(), steps.sh.end(), out.sh);
  return out;
}

std::vector<Integers> Quantiser::quantise(const Gaussians4D& part, const GroupSteps& steps,
                                          double segment_begin, int part_exponent,
                                          std::vector<std::uint32_t>& order) const {
  std::vector<Integers> out;
  out.push_back(position_integers(part, steps.position, steps.origin, order));
  Gaussians4D sorted = part.gather(order);
  minimise_rotations(sorted);
  out.push_back(time_integers(sorted, steps.lifespan.time, segment_begin));
  out.push_back(truncated_integers(sorted, Attribute::kSigma, steps.lifespan.sigma, 0.0f));
  out.push_back(
      truncated_integers(sorted, Attribute::kRadius, steps.lifespan.radius, kRadiusOffset));
  out.push_back(displacement_integers(sorted, steps.displacement, part_exponent));
  out.push_back(linear_integers(sorted, Attribute::kLogScale, Mapping::kLinear, steps.log_scale));
  out.push_back(rotation_integers(sorted, out.back(), steps.rotation));
  out.push_back(linear_integers(sorted, Attribute::kOpacity, Mapping::kLinear, rules_.opacity));
  for (const Attribute attribute :
       {Attribute::kSh0, Attribute::kSh1, Attribute::kSh2, Attribute::kSh3}) {
    const int band = band_of(attribute);
    if (band <= part.sh_degree) out.push_back(colour_integers(sorted, attribute, steps.sh[band]));
  }
  return out;
}

float Quantiser::position_step(const Gaussians4D& set) const {
  Step coarsest = step_for(extent_of(set, nullptr).largest() * 1.000001, kPositionBits);
  for (const TierSteps& steps : rules_.tiers) coarsest = coarser_of(coarsest, steps.position);
  return static_cast<float>(size_of(coarsest));
}

bool is_valid(const Quantisation& quantisation) {
  constexpr double kMaxOpacityStep = 4.0, kMinOpacityStep = 0x1p-8;
  const auto in = [](double value, double low, double high) {
    return value >= low && value <= high;
  };
  const auto is_step = [&in](Step step) {
    return in(step.exponent, kMinExponent, kMaxExponent) && in(step.multiplier, 1, 255) &&
           step.multiplier % 2 == 1;
  };
  bool good = in(quantisation.quality, 0, 100) && quantisation.longest_part > 0 &&
              quantisation.longest_part <= kMaxChunk && quantisation.max_error == 0 &&
              is_step(quantisation.opacity) &&
              in(size_of(quantisation.opacity), kMinOpacityStep, kMaxOpacityStep) &&
              in(quantisation.lifespans.time, -16, 16) &&
              in(quantisation.lifespans.lifespan, 4, 23) && quantisation.lifespans.motion >= 0 &&
              quantisation.lifespans.opacity >= 0 && quantisation.lifespans.edge >= 0 &&
              quantisation.near_distance > 0 && quantisation.near_displacement > 0 &&
              std::is_sorted(quantisation.bounds.rbegin(), quantisation.bounds.rend()) &&
              quantisation.tiers.size() == quantisation.bounds.size() + 1 &&
              quantisation.tiers.size() <= 256;
  for (const TierSteps& tier : quantisation.tiers) {
    good = good && is_step(tier.position) && is_step(tier.displacement) &&
           is_step(tier.log_scale) && is_step(tier.rotation) &&
           in(tier.rotation.exponent, kMinRotationExponent, 0) &&
           std::all_of(tier.sh.begin(), tier.sh.end(), is_step);
  }
  return good;
}

Quantisation choose_quantisation(const Gaussians4D& set, std::span<const float> importance,
                                 double ticks, double quality) {
  const StepChooser chooser(set, importance, false, ticks, quality, 0.0);
  Quantisation out = chooser.rules();
  const PartRange part{0, static_cast<std::uint32_t>(set.size()), {0.0, ticks}, {}};
  const std::span<const PartRange> parts(&part, 1);
  const Gaussians4D snapped = Quantiser(out).snap_lifespans(set, parts);
  const double chunk = choose_chunk(snapped, parts);
  const std::vector<SegmentMembers> segments = segments_of(snapped, part, chunk, false);
  const Demand demand = measure_demand(parts, {&segments, 1}, chunk, set.size());
  set_tiers(chooser, plan_tiers(importance, demand, 0), importance, out);
  for (TierSteps& tier : out.tiers) {
    for (std::size_t band = 1; band < 4; ++band)
      tier.sh[band] = step_near(std::log2(size_of(tier.sh[band])) + kTrainedSh, kFineSteps);
  }
  return out;
}

Gaussians4D round_lifespans(const Gaussians4D& set, const Quantisation& quantisation,
                            double ticks) {
  const PartRange part{0, static_cast<std::uint32_t>(set.size()), {0.0, ticks}, {}};
  return Quantiser(quantisation).snap_lifespans(set, {&part, 1});
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
  const float limit = kMaxImportance * percentile(out, 90);
  if (limit > 0.0f) {
    for (float& x : out) x = std::min(x, limit);
  }
  return out;
}

}  // namespace stgs
