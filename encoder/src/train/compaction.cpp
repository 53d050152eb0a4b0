// SPDX-License-Identifier: Apache-2.0
// Compaction, the last part of a run: removes the primitives that matter least, in rounds, then
// trains the others with quantisation in the loop, so that the decoded scene is the trained one.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "pack/most_important.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/parallel.h"
#include "train/camera_refinement.h"
#include "train/step_schedule.h"
#include "train/trainer.h"

namespace stgs::encoder {
namespace {

constexpr int kSizeSteps = 8;  // of a bisection for the size of the file
constexpr double kMinKeep = 0.002, kMaxQuality = 95;
// Fraction that a round keeps, unless there would be too many rounds. Removing a third at a time is
// 0.05 to 0.2 dB worse: the next round computes the importance of uncovered primitives.
constexpr double kRoundKeep = 0.9;
// With a target PSNR: rounds, the fraction that each keeps, images that are compared, and the
// quality of a scene that does not reach the target.
constexpr std::uint32_t kTargetRounds = 16;
constexpr double kTargetKeep = 0.8;
constexpr int kTargetViews = 16;
constexpr double kFineQuality = 90;

// Returns the rounds that remove all but the fraction `keep`.
std::uint32_t rounds_for(double keep, int most) {
  const double rounds = std::floor(std::log(keep) / std::log(kRoundKeep));
  return static_cast<std::uint32_t>(std::clamp(rounds, 1.0, static_cast<double>(most)));
}

// Returns the indices of the `count` largest values, ascending; of equal ones the first.
std::vector<std::uint32_t> largest(const std::vector<float>& values, std::size_t count) {
  std::vector<std::uint32_t> order(values.size());
  std::iota(order.begin(), order.end(), 0u);
  std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                   [&values](std::uint32_t a, std::uint32_t b) {
                     return values[a] != values[b] ? values[a] > values[b] : a < b;
                   });
  order.resize(count);
  std::sort(order.begin(), order.end());
  return order;
}

}  // namespace

double Trainer::compaction_progress() const {
  const double share = parameters_.compact_share;
  if (share == 0) return 0;
  return std::clamp((run_progress() - (1.0 - share)) / share, 0.0, 1.0);
}

Status Trainer::compact() {
  if (parameters_.compact_share == 0 || growth_progress() < 1.0) return {};
  const double progress = compaction_progress(), until = parameters_.compact_prune_share;
  const bool targeted = settings_.target_psnr > 0;
  CompactionState& compaction = state_.compaction;
  if (compaction.prunings == 0) STGS_TRY(choose_size());
  const std::uint32_t rounds =
      targeted ? kTargetRounds : rounds_for(compaction.keep, parameters_.compact_rounds);
  while (compaction.prunings < rounds && progress >= until * compaction.prunings / rounds) {
    double psnr = 0;
    if (targeted) {
      STGS_ASSIGN(psnr, training_psnr());
    }
    const bool further = !targeted || can_prune(psnr);
    STGS_TRY(prune(!further   ? 1.0
                   : targeted ? kTargetKeep
                              : std::pow(compaction.keep, 1.0 / rounds)));
    // Only now, so that a round that is cancelled is repeated as it was.
    compaction.prunings = further ? compaction.prunings + 1 : rounds;
    compaction.psnr = psnr;
  }
  if (!compaction.is_rounding() && compaction.prunings == rounds && progress >= until) {
    STGS_TRY(begin_rounding());
  }
  return {};
}

Status Trainer::choose_size() {
  CompactionState& compaction = state_.compaction;
  compaction.keep = parameters_.compact_keep;
  compaction.quality = parameters_.compact_quality;
  const double limit = byte_limit(settings_, capture_.time_base, capture_.frames);
  if (limit == 0) return {};
  STGS_ASSIGN(const std::vector<float> importance, pruning_importance());
  // Fixed primitives were stored before.
  const std::vector<std::uint32_t> trained = state_.list_trained();
  Scene scene;
  scene.metadata.frames = static_cast<std::uint32_t>(capture_.frames);
  scene.gaussians = state_.set.gather(trained);
  for (const std::uint32_t i : trained) scene.importance.push_back(importance[i]);
  const std::vector<std::uint32_t> ranked = rank_by_importance(scene);
  STGS_ASSIGN(const double all, packed_bytes(scene, ranked, 1.0, compaction.quality));
  if (all <= limit) {  // all primitives, at the greatest quality that fits
    double low = compaction.quality, high = kMaxQuality;
    for (int k = 0; k < kSizeSteps; ++k) {
      const double middle = 0.5 * (low + high);
      STGS_ASSIGN(const double bytes, packed_bytes(scene, ranked, 1.0, middle));
      (bytes <= limit ? low : high) = middle;
    }
    compaction.keep = 1.0;
    compaction.quality = low;
  } else {
    double low = std::log(kMinKeep), high = 0.0;
    for (int k = 0; k < kSizeSteps; ++k) {
      const double middle = 0.5 * (low + high);
      STGS_ASSIGN(const double bytes,
                  packed_bytes(scene, ranked, std::exp(middle), compaction.quality));
      (bytes <= limit ? low : high) = middle;
    }
    compaction.keep = std::exp(low);
  }
  log_(2, fmt::format("iteration {}: keeping {:.1f} % of {} primitives for {:.0f} bytes",
                      state_.iteration, 100.0 * compaction.keep, state_.size(), limit));
  return {};
}

Result<double> Trainer::training_psnr() {
  STGS_TRY(synchronise());
  STGS_ASSIGN(const HeldOutViews views,
              HeldOutViews::load(with_refined_cameras(capture_, state_), false, kTargetViews));
  return views.evaluate(state_.set, state_.background, parameters_.kernel).psnr_cc;
}

// The next round is expected to lose as much as the last one.
bool Trainer::can_prune(double now) {
  CompactionState& compaction = state_.compaction;
  const double lost = compaction.prunings == 0 ? 0.0 : std::max(0.0, compaction.psnr - now);
  log_(2, fmt::format("iteration {}: {} primitives, training images {:.2f} dB (target {:g})",
                      state_.iteration, state_.size(), now, settings_.target_psnr));
  if (compaction.prunings == 0 && now < settings_.target_psnr) {
    log_(1, fmt::format("training reached {:.2f} dB on the training images, less than the target "
                        "of {:g}; no primitives are removed",
                        now, settings_.target_psnr));
    compaction.quality = std::max(compaction.quality, kFineQuality);
  }
  return now - lost >= settings_.target_psnr;
}

Result<double> Trainer::packed_bytes(const Scene& scene, const std::vector<std::uint32_t>& ranked,
                                     double share, double quality) const {
  const auto count =
      static_cast<std::size_t>(std::ceil(share * static_cast<double>(ranked.size())));
  Scene part = most_important(scene, ranked, count);
  part.quantisation =
      choose_quantisation(part.gaussians, part.importance, capture_.frames, quality);
  WriteSettings write;
  write.profile = Profile::kQuantised;
  write.own_steps = true;
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, encode_scene(part, write));
  return static_cast<double>(bytes.size());
}

Result<std::vector<float>> Trainer::importance_now() {
  STGS_TRY(synchronise());
  Result<std::vector<float>> found = importance();
  if (!found.ok()) {
    STGS_TRY(save_checkpoint());
    return found.status();
  }
  if (found->size() == state_.size()) return found;
  return runtime_error(
      "the importances of the primitives could not be computed, which the compaction needs; train "
      "without it (--set compact_share=0)");
}

Result<std::vector<float>> Trainer::pruning_importance() {
  STGS_ASSIGN(std::vector<float> importance, importance_now());
  if (is_live()) pruned_importance_ = importance;
  for (std::size_t i = 0; i < importance.size(); ++i) {
    const double life = 2.0 * (state_.set.radius[i] + double{state_.set.sigma[i]});
    const double share = std::clamp(life / capture_.frames, 1.0 / capture_.frames, 1.0);
    importance[i] *= static_cast<float>(std::pow(share, -parameters_.compact_moving));
  }
  return importance;
}

Status Trainer::prune(double keep) {
  if (keep >= 1.0) return {};
  STGS_ASSIGN(std::vector<float> importance, pruning_importance());
  const std::size_t fixed = state_.count_fixed();
  for (std::size_t i = 0; i < state_.size(); ++i) {
    if (state_.is_fixed(i)) importance[i] = std::numeric_limits<float>::infinity();
  }
  const auto count = fixed + static_cast<std::size_t>(
                                 std::ceil(keep * static_cast<double>(state_.size() - fixed)));
  if (count < state_.size()) {
    const std::vector<std::uint32_t> kept = largest(importance, count);
    state_.retain(kept);
    std::vector<float> all = std::exchange(pruned_importance_, {});
    if (!all.empty()) gather_rows(all, 1, kept, pruned_importance_);
  }
  return backend_->begin(state_);
}

Status Trainer::begin_rounding() {
  CompactionState& compaction = state_.compaction;
  if (pruned_importance_.size() == state_.size()) {
    STGS_TRY(synchronise());
    compaction.importance = std::exchange(pruned_importance_, {});
  } else {
    STGS_ASSIGN(compaction.importance, importance_now());
  }
  const double frames = capture_.frames;
  const std::vector<std::uint32_t> trained = state_.list_trained();
  Gaussians4D set = state_.set.gather(trained);
  std::vector<float> importance;
  for (const std::uint32_t i : trained) importance.push_back(compaction.importance[i]);
  Quantisation quantisation = choose_quantisation(set, importance, frames, compaction.quality);
  set = round_lifespans(set, quantisation, frames);
  for (std::size_t k = 0; k < trained.size(); ++k) {
    const std::uint32_t i = trained[k];
    state_.set.time[i] = set.time[k];
    state_.set.sigma[i] = set.sigma[k];
    state_.set.radius[i] = set.radius[k];
    state_.set.opacity_logit[i] = set.opacity_logit[k];
    for (std::size_t c = 0; c < 3; ++c) {
      state_.set.position[3 * i + c] = set.position[3 * k + c];
      state_.set.velocity[3 * i + c] = set.velocity[3 * k + c];
    }
    const float sigma = state_.set.sigma[i], radius = state_.set.radius[i];
    const float f = ablation_.modulation ? math::lifespan_modulation(sigma, radius) : 1.0f;
    state_.log_sigma[i] = std::log(sigma);
    for (std::size_t c = 0; c < 3; ++c)
      state_.velocity[3 * i + c] = f * state_.set.velocity[3 * i + c];
  }
  compaction.tier.clear();
  for (const float x : compaction.importance)
    compaction.tier.push_back(static_cast<std::uint8_t>(quantisation.tier_of(x)));
  compaction.rules = rounding_rules(quantisation, frames, state_.set, compaction.tier);
  compaction.quantisation = std::move(quantisation);
  log_(2, fmt::format("iteration {}: {} primitives remain; training for packing", state_.iteration,
                      state_.size()));
  return backend_->begin(state_);
}

// Lifespans do not change any more once they are rounded.
void Trainer::set_compaction_schedule(StepInput& input) const {
  const HyperParameters& p = parameters_;
  const double progress = compaction_progress();
  set_schedule(p, capture_, p.compact_restart + (1.0 - p.compact_restart) * progress, false, input);
  const auto decay = static_cast<float>(std::pow(p.compact_decay, progress));
  input.sh_degree = p.sh_degree;
  for (float& rate : input.rates) rate *= decay;
  input.rate_sh0 *= decay;
  if (!state_.compaction.is_rounding()) return;
  for (const int a : {kTime, kLogSigma, kRadius}) input.rates[static_cast<std::size_t>(a)] = 0;
  input.learn_radius = false;
  input.weight_rate = static_cast<float>(p.compact_rate);
}

}  // namespace stgs::encoder
