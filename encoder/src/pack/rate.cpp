// SPDX-License-Identifier: Apache-2.0
#include "pack/rate.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "pack/most_important.h"
#include "stgs/format/differences.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {
namespace {

constexpr int kMaxTightenings = 4;  // of the bound, if the first does not meet max_error

// The primitive with the max_error position error at any time.
struct WorstPrimitive {
  double error = HUGE_VAL;  // scene units
  std::size_t primitive = 0;
  math::Vec3 position{};   // at its T, as decoded
  bool by_motion = false;  // the error is due to its motion, not to its position at its T
};

// Returns the position error of decoded primitive j at its T, scene units.
double position_error(const Gaussians4D& set, std::size_t i, const Gaussians4D& decoded,
                      std::size_t j) {
  const double dt = double{decoded.time[j]} - set.time[i];
  double squared = 0.0;
  for (std::size_t c = 0; c < 3; ++c) {
    const double x = set.position[3 * i + c] + set.velocity[3 * i + c] * dt;
    squared += (x - decoded.position[3 * j + c]) * (x - decoded.position[3 * j + c]);
  }
  return std::sqrt(squared);
}

void measure_positions(const Scene& scene, Packed& packed, WorstPrimitive& worst) {
  double max_error = -1.0, squares = 0.0;
  const Scene& decoded = packed.decoded;
  for_each_in_part(decoded, [&](std::size_t i, const TickRange& part) {
    const double error = trajectory_error(scene.gaussians, packed.order[i], decoded.gaussians, i,
                                          part.end - part.begin);
    if (error > max_error) {
      max_error = error;
      const std::size_t j = packed.order[i];
      const double at_own_time = position_error(scene.gaussians, j, decoded.gaussians, i);
      const float* x = &decoded.gaussians.position[3 * i];
      worst = {error, j, {x[0], x[1], x[2]}, at_own_time < 0.5 * error};
    }
    squares += error * error;
  });
  packed.position_max = std::max(0.0, max_error);
  packed.position_rms =
      std::sqrt(squares / std::max(1.0, static_cast<double>(packed.order.size())));
}

WriteSettings write_settings(const PackSettings& settings, double quality) {
  WriteSettings out;
  out.profile = settings.profile;
  out.own_steps = quality == 0;
  if (quality > 0) out.quality = quality;
  out.tiers = settings.tiers;
  out.chunk_seconds = settings.chunk_seconds;
  out.max_error = settings.max_error / 1000.0;
  return out;
}

// Decodes the packed bytes, so that every file that pack writes has been read once.
Status decode(const Scene& scene, Packed& packed, WorstPrimitive& worst) {
  STGS_ASSIGN(packed.decoded, read_scene(memory_source(packed.bytes, "the packed scene")));
  measure_positions(scene, packed, worst);
  return {};
}

// Packs at a quality and decodes the result. Uses the first bound on quantisation steps that meets
// max_error; it must be tighter than max_error if a lifespan is rounded too. If no bound does, sets
// `too_far` to the primitive of the attempt with the smallest error.
Result<Packed> pack_at(const Scene& scene, const PackSettings& settings, double quality,
                       const std::function<Status()>& before_attempt,
                       std::optional<WorstPrimitive>& too_far) {
  WriteSettings write = write_settings(settings, quality);
  const double bound = write.max_error;
  WorstPrimitive best;
  for (int attempt = 0; attempt <= kMaxTightenings; ++attempt, write.max_error *= 0.5) {
    STGS_TRY(before_attempt());
    Packed packed;
    packed.quality =
        write.own_steps && scene.quantisation ? scene.quantisation->quality : write.quality;
    STGS_ASSIGN(packed.bytes, encode_scene(scene, write, &packed.order));
    WorstPrimitive worst;
    STGS_TRY(decode(scene, packed, worst));
    if (bound == 0.0 || packed.position_max <= bound) return packed;
    if (worst.error < best.error) best = worst;
  }
  too_far = best;
  return Packed{};
}

Status unreachable_error(const Scene& scene, const PackSettings& settings,
                         const WorstPrimitive& worst) {
  const double digits = std::pow(10.0, std::floor(std::log10(1000.0 * worst.error)) - 2.0);
  const double best = std::ceil(1000.0 * worst.error / digits) * digits;
  const float* u = &scene.gaussians.velocity[3 * worst.primitive];
  const std::string cause =
      worst.by_motion
          ? fmt::format("because primitive {} moves by {:.3g} units per frame", worst.primitive,
                        std::hypot(double{u[0]}, double{u[1]}, double{u[2]}))
          : fmt::format("because primitive {} is at ({:g}, {:g}, {:g}) and positions have 21 bits",
                        worst.primitive, worst.position.x, worst.position.y, worst.position.z);
  return unsupported(
      "--max-error {:g} cannot be met: the smallest possible error is {:.3g} thousandths of a "
      "scene "
      "unit, {}; allow that error, or remove the primitives that {}",
      settings.max_error, best, cause, worst.by_motion ? "move so fast" : "are so far out");
}

// Packs attempts within a number of bytes.
class LimitedPacking {
 public:
  LimitedPacking(const Scene& scene, const PackSettings& settings,
                 const std::function<Status()>& before_attempt, double limit)
      : scene_(scene), settings_(settings), before_attempt_(before_attempt), limit_(limit) {
    ranked_ = rank_by_importance(scene);
  }

  // Finds the best file: of the greatest quality, down to the lowest one that is worth its loss,
  // then with as many primitives as fit, then of any quality.
  Result<Packed> find() {
    if (scene_.quantisation) {  // no steps are better than those that the scene was trained for
      STGS_TRY(find_count(0));
      if (!best_.bytes.empty()) return std::move(best_);
    }
    STGS_TRY(find_quality(kMinWorthwhile, 100, 1.0));
    if (best_.bytes.empty()) STGS_TRY(find_count(kMinWorthwhile));
    if (best_.bytes.empty()) STGS_TRY(find_quality(kQualityStep, kMinWorthwhile, kMinShare));
    if (!best_.bytes.empty()) return std::move(best_);
    if (too_far_) return unreachable_error(scene_, settings_, *too_far_);
    return usage_error(
        "the limit of {:.0f} bytes is too low for this scene: {} of its primitives take {} bytes "
        "at quality {:g}",
        limit_, count_of(kMinShare), smallest_, kQualityStep);
  }

 private:
  // Lowest quality that loses less than leaving out primitives does, and the least share of the
  // primitives.
  static constexpr double kMinWorthwhile = 70, kMinShare = 0.02;
  static constexpr double kQualityStep = 0.125;
  static constexpr int kCountSteps = 10;  // of the bisection of the number of primitives

  std::size_t count_of(double share) const {
    return static_cast<std::size_t>(std::ceil(share * static_cast<double>(ranked_.size())));
  }

  // Bisects for the greatest quality in [low, high] that fits. If max_error cannot be met at a
  // quality, it may be at a higher one, whose lifespans are finer.
  Status find_quality(double low, double high, double share) {
    const Scene part = most_important(scene_, ranked_, count_of(share));
    auto first = static_cast<int>(low / kQualityStep) - 1;
    auto last = static_cast<int>(high / kQualityStep) + 1;
    while (last - first > 1) {
      const int middle = first + (last - first) / 2;
      STGS_ASSIGN(const Outcome outcome, attempt(part, middle * kQualityStep));
      (outcome == Outcome::kTooLarge ? last : first) = middle;
    }
    return {};
  }

  // Bisects for the greatest number of primitives that fits at a quality; 0: the scene's own steps.
  Status find_count(double quality) {
    double low = std::log(kMinShare), high = 0.0;
    STGS_ASSIGN(const Outcome all, attempt(scene_, quality));
    if (all != Outcome::kTooLarge) return {};
    for (int k = 0; k < kCountSteps; ++k) {
      const double middle = 0.5 * (low + high);
      const Scene part = most_important(scene_, ranked_, count_of(std::exp(middle)));
      STGS_ASSIGN(const Outcome outcome, attempt(part, quality));
      (outcome == Outcome::kTooLarge ? high : low) = middle;
    }
    return {};
  }

  enum class Outcome { kFits, kTooLarge, kTooFar };
  Result<Outcome> attempt(const Scene& part, double quality) {
    std::optional<WorstPrimitive> too_far;
    STGS_ASSIGN(Packed packed, pack_at(part, settings_, quality, before_attempt_, too_far));
    if (too_far) {
      if (!too_far_ || too_far->error < too_far_->error) too_far_ = too_far;
      return Outcome::kTooFar;
    }
    const std::size_t bytes = packed.bytes.size();
    if (smallest_ == 0 || bytes < smallest_) smallest_ = bytes;
    if (static_cast<double>(bytes) > limit_) return Outcome::kTooLarge;
    // The order refers to the part; its primitives are in the order of the scene.
    if (part.gaussians.size() < scene_.gaussians.size()) {
      std::vector<std::uint32_t> members(
          ranked_.begin(), ranked_.begin() + std::ssize(part.gaussians.opacity_logit));
      std::sort(members.begin(), members.end());
      for (std::uint32_t& i : packed.order) i = members[i];
      packed.left_out = scene_.gaussians.size() - part.gaussians.size();
    }
    best_ = std::move(packed);
    return Outcome::kFits;
  }

  const Scene& scene_;
  const PackSettings& settings_;
  const std::function<Status()>& before_attempt_;
  double limit_;
  std::vector<std::uint32_t> ranked_;
  Packed best_;
  std::optional<WorstPrimitive> too_far_;
  std::size_t smallest_ = 0;
};

}  // namespace

double kbps_of(std::uint64_t bytes, const SceneMetadata& metadata) {
  return static_cast<double>(bytes) * 8e-3 / metadata.time_base.seconds(metadata.frames);
}

Result<Packed> pack_within(const Scene& scene, const PackSettings& settings,
                           const std::function<Status()>& before_attempt) {
  const double limit =
      byte_limit(settings, scene.metadata.time_base, static_cast<double>(scene.metadata.frames));
  if (limit > 0) return LimitedPacking(scene, settings, before_attempt, limit).find();
  std::optional<WorstPrimitive> too_far;
  STGS_ASSIGN(Packed packed, pack_at(scene, settings, settings.quality, before_attempt, too_far));
  if (too_far) return unreachable_error(scene, settings, *too_far);
  return packed;
}

}  // namespace stgs::encoder
