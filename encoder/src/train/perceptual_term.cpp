// SPDX-License-Identifier: Apache-2.0
#include "train/perceptual_term.h"

#include <algorithm>

#include "perceptual/patch.h"
#include "train/random.h"

namespace stgs::encoder {
namespace {

Result<std::shared_ptr<const FeatureNetwork>> read_network(const std::string& path) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return read_feature_network(std::move(source), ChannelWeights::kOptional);
}

}  // namespace

Result<PerceptualTerm> PerceptualTerm::create(const TrainSettings& settings,
                                              const HyperParameters& parameters,
                                              const TrainBackend& backend, const LogSink& log) {
  PerceptualTerm term;
  if (settings.perceptual_weights.empty()) {
    log(3, "perceptual loss disabled (no --perceptual-weights)");
    return term;
  }
  STGS_TRY(backend.check_perceptual());
  STGS_ASSIGN(term.network_, read_network(settings.perceptual_weights));
  const int min_side = term.network_->min_side();
  if (parameters.perceptual_patch > 0 && parameters.perceptual_patch < min_side) {
    return usage_error(
        "perceptual_patch is out of range (expected 0, the complete image, or at least {} pixels, "
        "got {})",
        min_side, parameters.perceptual_patch);
  }
  term.file_ = settings.perceptual_weights;
  term.weight_ = parameters.weight_perceptual;
  term.from_ = parameters.perceptual_from;
  term.patch_ = parameters.perceptual_patch;
  term.half_sizes_ = parameters.coarse_until > 0;
  log(2, fmt::format("perceptual loss enabled: LPIPS ({}){}, weights from {}", term.network_->name,
                     term.network_->linear ? ""
                                           : " with uniform channel weights (the file has no "
                                             "LPIPS linear layers)",
                     term.file_));
  if (backend.name().rfind("cpu", 0) == 0) {
    log(1,
        "perceptual loss: slow on the CPU; to speed it up, reduce perceptual_patch or raise "
        "perceptual_from");
  }
  return term;
}

Status PerceptualTerm::check_sizes(const std::vector<Camera>& cameras) const {
  if (!is_on()) return {};
  for (const Camera& camera : cameras) {
    if (camera.test) continue;
    const int shorter = std::min(camera.width, camera.height) / (half_sizes_ ? 2 : 1);
    if (shorter >= network_->min_side()) continue;
    return usage_error(
        "camera '{}': images of {}x{}{} are too small for the perceptual loss (expected at least "
        "{} pixels per side); omit --perceptual-weights",
        camera.name, camera.width, camera.height, half_sizes_ ? ", halved at first," : "",
        network_->min_side());
  }
  return {};
}

void PerceptualTerm::plan(TrainPlan& plan) const {
  if (!is_on()) return;
  plan.perceptual = network_;
  plan.perceptual_patch = patch_;
  plan.width = std::max(plan.width, network_->min_side());
  plan.height = std::max(plan.height, network_->min_side());
}

void PerceptualTerm::apply(std::uint64_t seed, std::uint64_t iteration, double progress,
                           StepInput& input) const {
  if (!is_on() || progress < from_) return;
  input.weight_perceptual = static_cast<float>(weight_);
  Random random(seed, iteration, RandomPurpose::kPatch);
  input.patch = random_patch(static_cast<int>(input.camera.width),
                             static_cast<int>(input.camera.height), patch_, random);
}

std::string PerceptualTerm::fingerprint() const {
  return is_on() ? fmt::format("{:016x}", network_->hash) : "off";
}

std::optional<PerceptualReport> PerceptualTerm::report() const {
  if (!is_on()) return std::nullopt;
  return PerceptualReport{file_, network_->name, network_->linear, weight_, patch_};
}

}  // namespace stgs::encoder
