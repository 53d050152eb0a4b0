// SPDX-License-Identifier: Apache-2.0
#include "pack/rate.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "pack/attempt.h"
#include "pack/most_important.h"
#include "pack/render_psnr.h"

namespace stgs::encoder {
namespace {

// Makes the order of a file of the `count` most important primitives refer to the complete scene.
void refer_to_scene(const std::vector<std::uint32_t>& ranked, std::size_t count, Packed& packed) {
  std::vector<std::uint32_t> members(ranked.begin(),
                                     ranked.begin() + static_cast<std::ptrdiff_t>(count));
  std::sort(members.begin(), members.end());
  for (std::uint32_t& i : packed.order) i = members[i];
  packed.left_out = ranked.size() - count;
}

// Packs attempts within a number of bytes.
class LimitedPacking {
 public:
  LimitedPacking(const Scene& scene, const PackSettings& settings,
                 const std::function<Status()>& before_attempt, double limit)
      : scene_(scene), settings_(settings), before_attempt_(before_attempt), limit_(limit) {
    ranked_ = rank_by_importance(scene);
  }

  // Finds the best file within the limit. A scene with steps of its own keeps them, and as many
  // primitives as fit. Otherwise: the greatest quality down to kMinWorthwhile; else as many
  // primitives as fit at that quality; else a lower quality of the least share of them.
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
        "at quality {:g}; raise the limit",
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
    refer_to_scene(ranked_, part.gaussians.size(), packed);
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

// Packs attempts whose renders match those of the scene.
class FaithfulPacking {
 public:
  FaithfulPacking(const Scene& scene, const PackSettings& settings,
                  const std::function<Status()>& before_attempt)
      : scene_(scene), settings_(settings), before_attempt_(before_attempt) {}

  // Finds the smallest file with the PSNR: of a scene that was trained for its steps, that with the
  // fewest primitives, of another one, that of the lowest quality.
  Result<Packed> find() {
    if (!scene_.metadata.start_camera) {
      return usage_error(
          "--target-psnr needs a start camera, from which renders are compared; this scene has "
          "none");
    }
    const bool own = scene_.quantisation.has_value();
    if (own) ranked_ = rank_by_importance(scene_);
    // Values in [low, high]: steps of quality, or hundredths of the logarithm of the share.
    int low = own ? kMinShare : 0, high = own ? 0 : kQualities;
    STGS_ASSIGN(const bool possible, attempt(high));
    while (possible && high - low > 1) {
      const int middle = low + (high - low) / 2;
      STGS_ASSIGN(const bool reached, attempt(middle));
      (reached ? high : low) = middle;
    }
    if (!best_.bytes.empty()) return std::move(best_);
    if (too_far_) return unreachable_error(scene_, settings_, *too_far_);
    if (own) {
      return usage_error(
          "--target-psnr {:g} cannot be reached with the steps that the scene was trained for "
          "({:.1f} dB); use --quality 100 or --profile near-lossless",
          settings_.target_psnr, psnr_);
    }
    return usage_error("--target-psnr {:g} cannot be reached: the best file has {:.1f} dB",
                       settings_.target_psnr, psnr_);
  }

 private:
  static constexpr int kQualities = 400;  // steps of a quarter
  static constexpr int kMinShare = -400;

  Result<bool> attempt(int value) {
    const bool own = scene_.quantisation.has_value();
    const auto count = static_cast<std::size_t>(
        std::ceil(std::exp(0.01 * value) * static_cast<double>(ranked_.size())));
    std::optional<WorstPrimitive> too_far;
    Result<Packed> packed =
        own ? pack_at(most_important(scene_, ranked_, count), settings_, 0, before_attempt_,
                      too_far)
            : pack_at(scene_, settings_, 100.0 * value / kQualities, before_attempt_, too_far);
    if (!packed.ok()) return packed.status();
    if (too_far) {
      too_far_ = too_far;
      return false;
    }
    psnr_ = render_psnr(scene_, packed->decoded).value_or(0);
    if (psnr_ < settings_.target_psnr) return false;
    if (own) refer_to_scene(ranked_, count, *packed);
    best_ = *std::move(packed);
    return true;
  }

  const Scene& scene_;
  const PackSettings& settings_;
  const std::function<Status()>& before_attempt_;
  std::vector<std::uint32_t> ranked_;
  Packed best_;
  std::optional<WorstPrimitive> too_far_;
  double psnr_ = 0;  // of the latest attempt
};

}  // namespace

double kbps_of(std::uint64_t bytes, const SceneMetadata& metadata) {
  return static_cast<double>(bytes) * 8e-3 / metadata.time_base.seconds(metadata.frames);
}

Result<Packed> pack_within(const Scene& scene, const PackSettings& settings,
                           const std::function<Status()>& before_attempt) {
  const double limit =
      byte_limit(settings, scene.metadata.time_base, static_cast<double>(scene.metadata.frames));
  if (settings.target_psnr > 0) return FaithfulPacking(scene, settings, before_attempt).find();
  if (limit > 0) return LimitedPacking(scene, settings, before_attempt, limit).find();
  std::optional<WorstPrimitive> too_far;
  STGS_ASSIGN(Packed packed, pack_at(scene, settings, settings.quality, before_attempt, too_far));
  if (too_far) return unreachable_error(scene, settings, *too_far);
  return packed;
}

}  // namespace stgs::encoder
