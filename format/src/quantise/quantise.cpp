// SPDX-License-Identifier: Apache-2.0
#include "quantise/quantise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "quantise/axis_turns.h"
#include "quantise/extents.h"
#include "quantise/integers.h"
#include "quantise/step_chooser.h"
#include "stgs/format/math/blend.h"

namespace stgs {
namespace {

// Bits of a displacement in steps: its product with a multiplier stays below 2^23.
constexpr int kDisplacementBits = 22, kFineDisplacementBits = 19;
constexpr double kHardEdge = 0.25, kFineHardEdge = 0x1p-6;  // error of l at hard edges
constexpr float kMaxLogit = 12.0f, kFineMaxLogit = 24.0f;   // beyond it, floats are 0 or 1
constexpr double kDistanceOctaves = 4.0;                    // range of outliers that share a layout
constexpr int kMaxDistances = 12;  // limits the tiers of a segment (spec 5.7)
// Bound of the importance by size, as a multiple of the 90th percentile. A sky dome covers a
// million times the area of a splat and would dominate the mean.
constexpr float kMaxImportance = 64.0f;
constexpr double kTrainedSh = 1.0;  // octaves by which SH steps are coarser if trained for them

// Returns the smallest power of two with which numbers up to `largest` fit into `bits` bits.
Step step_for(double largest, int bits) {
  return power_above(largest > 0.0 ? std::ceil(std::log2(largest)) - bits : kMinExponent);
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

double max_displacement(const Gaussians4D& set, const std::vector<std::uint32_t>& members,
                        int part_exponent) {
  double out = 0.0;
  for (const std::uint32_t i : members) out = std::max(out, displacement_of(set, i, part_exponent));
  return out;
}

LifespanBounds bounds_of(const Quantisation& rules) {
  const LifespanRounding& rounding = rules.lifespans;
  const bool fine = rules.near_lossless;
  return {rounding.motion,
          rounding.opacity,
          fine ? 0.5 * size_of(rules.opacity) : HUGE_VAL,
          rounding.edge,
          fine ? kFineHardEdge : kHardEdge,
          fine ? kFineMaxLogit : kMaxLogit};
}

}  // namespace

Quantiser::Quantiser(const Quantisation& rules)
    : rules_(rules),
      lifespans_(rules.longest_part, rules.lifespans.time, rules.lifespans.lifespan, rules.opacity,
                 bounds_of(rules)) {}

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
  // One value fewer than the bits have, because the origin is rounded down.
  out.position = coarser_of(
      steps.position, step_for(extent.largest() * 1.000001, position_bits(rules_.near_lossless)));
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
  out.push_back(position_integers(part, steps.position, steps.origin,
                                  position_bits(rules_.near_lossless), order));
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
  Step coarsest =
      step_for(extent_of(set, nullptr).largest() * 1.000001, position_bits(rules_.near_lossless));
  for (const TierSteps& steps : rules_.tiers) coarsest = coarser_of(coarsest, steps.position);
  return static_cast<float>(size_of(coarsest));
}

bool is_valid(const Quantisation& quantisation) {
  constexpr double kMaxOpacityStep = 4.0, kMinOpacityStep = 0x1p-8;
  // Finer steps could not represent common values: integers of the mapping end at 2^22 of them.
  constexpr int kMinFineExponent = -16, kMaxTimeBits = 22;
  const auto in = [](double value, double low, double high) {
    return value >= low && value <= high;
  };
  const auto is_step = [&in](Step step) {
    return in(step.exponent, kMinExponent, kMaxExponent) && in(step.multiplier, 1, 255) &&
           step.multiplier % 2 == 1;
  };
  bool good = in(quantisation.quality, 0, 100) && quantisation.longest_part > 0 &&
              quantisation.longest_part <= kMaxChunk && quantisation.max_error == 0 &&
              !quantisation.near_lossless && is_step(quantisation.opacity) &&
              in(size_of(quantisation.opacity), kMinOpacityStep, kMaxOpacityStep) &&
              in(quantisation.lifespans.time, -16, 16) &&
              quantisation.longest_part <= std::exp2(quantisation.lifespans.time + kMaxTimeBits) &&
              in(quantisation.lifespans.lifespan, 4, 23) && quantisation.lifespans.motion >= 0 &&
              quantisation.lifespans.opacity >= 0 && quantisation.lifespans.edge >= 0 &&
              quantisation.near_distance > 0 && quantisation.near_displacement > 0 &&
              std::is_sorted(quantisation.bounds.rbegin(), quantisation.bounds.rend()) &&
              quantisation.tiers.size() == quantisation.bounds.size() + 1 &&
              quantisation.tiers.size() <= 256;
  for (const TierSteps& tier : quantisation.tiers) {
    const auto is_fine_step = [&](Step step) {
      return is_step(step) && step.exponent >= kMinFineExponent;
    };
    good = good && is_step(tier.position) && is_step(tier.displacement) &&
           is_fine_step(tier.log_scale) && is_step(tier.rotation) &&
           in(tier.rotation.exponent, kMinRotationExponent, kMaxRotationExponent) &&
           std::all_of(tier.sh.begin(), tier.sh.end(), is_fine_step);
  }
  return good;
}

Quantisation choose_quantisation(const Gaussians4D& set, std::span<const float> importance,
                                 double ticks, double quality) {
  const StepChooser chooser(set, importance, false, ticks, {quality});
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
