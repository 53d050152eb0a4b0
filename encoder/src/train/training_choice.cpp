// SPDX-License-Identifier: Apache-2.0
#include "train/training_choice.h"

#include <xxhash.h>

#include <algorithm>
#include <initializer_list>

#include "perceptual/vgg_layers.h"
#include "stgs/encoder/windows.h"
#include "stgs/format/math/sh.h"
#include "train/checkpoint.h"

namespace stgs::encoder {
namespace {

// Hyper-parameters that nothing asks for with a part of the method, or without it.
struct Idle {
  bool Ablation::*part;
  bool idle_with;  // the part; else without
  const char* ablation;
  std::initializer_list<const char*> parameters;
};

const Idle kIdle[] = {
    {&Ablation::densification,
     true,
     "densification",
     {"plain_until", "plain_prune", "plain_reset"}},
    {&Ablation::densification,
     false,
     "densification",
     {"densify_until", "growth_limit", "opacity_resets", "prune_opacity", "replace_limit",
      "score_error", "score_opacity", "score_lifespan"}},
    {&Ablation::lifespan, false, "lifespan", {"lr_radius", "initial_radius"}},
    {&Ablation::representation,
     false,
     "representation",
     {"lr_velocity", "lr_velocity_final", "velocity_shrink", "still_from", "still_least"}}};

// That each override is of something that is used.
Status check_used(const TrainSettings& settings, const Ablation& ablation) {
  for (const auto& [name, value] : settings.overrides) {
    for (const Idle& idle : kIdle) {
      const bool listed =
          std::find(idle.parameters.begin(), idle.parameters.end(), name) != idle.parameters.end();
      if (!listed || ablation.*idle.part != idle.idle_with) continue;
      return usage_error("--set {}={} has no effect {} --ablate {}; leave it out", name, value,
                         idle.idle_with ? "without" : "with", idle.ablation);
    }
  }
  return {};
}

}  // namespace

Result<TrainingChoice> choose_training(const TrainSettings& settings) {
  TrainingChoice choice;
  STGS_ASSIGN(choice.parameters, preset_hyper_parameters(settings.preset));
  if (settings.iterations > 0) choice.parameters.iterations = settings.iterations;
  if (settings.max_primitives > 0) choice.parameters.max_primitives = settings.max_primitives;
  for (const auto& [name, value] : settings.overrides) {
    STGS_TRY(set_hyper_parameter(choice.parameters, name, value));
  }
  STGS_TRY(check_hyper_parameters(choice.parameters));
  STGS_ASSIGN(choice.ablation, Ablation::from_names(settings.ablate));
  STGS_TRY(check_used(settings, choice.ablation));
  return choice;
}

std::uint64_t settings_id_of(const TrainSettings& settings, const TrainingChoice& choice,
                             const PerceptualTerm& perceptual) {
  Fingerprint entries = list_hyper_parameters(choice.parameters);
  entries.emplace_back("ablate", fmt::format("{}", fmt::join(choice.ablation.names(), ",")));
  entries.emplace_back("max_seconds", fmt::format("{}", settings.max_seconds));
  entries.emplace_back("perceptual weights", perceptual.fingerprint());
  const std::string text = fingerprint_text(entries);
  return XXH3_64bits(text.data(), text.size());
}

Result<std::uint64_t> settings_id(const TrainSettings& settings) {
  STGS_ASSIGN(const TrainingChoice choice, choose_training(settings));
  STGS_ASSIGN(const std::unique_ptr<TrainBackend> backend, make_backend(settings.backend));
  const auto silent = [](int, const std::string&) {};
  STGS_ASSIGN(const PerceptualTerm perceptual,
              PerceptualTerm::create(settings, choice.parameters, *backend, silent));
  return settings_id_of(settings, choice, perceptual);
}

TrainPlan train_plan(const TrainingChoice& choice, const PerceptualTerm& perceptual,
                     const std::vector<Camera>& cameras) {
  TrainPlan plan;
  plan.primitives = static_cast<std::size_t>(choice.parameters.max_primitives);
  plan.sh_coefficients = math::sh_coefficients(choice.parameters.sh_degree);
  plan.width = plan.height = kVggSmallest;  // where no camera is known, what every term takes
  for (const Camera& camera : cameras) {
    if (camera.test) continue;
    plan.width = std::max(plan.width, camera.width);
    plan.height = std::max(plan.height, camera.height);
  }
  plan.coupled = !choice.ablation.representation;
  plan.normals = choice.parameters.weight_normal > 0 && !plan.coupled;
  perceptual.plan(plan);
  return plan;
}

Status check_training(const TrainSettings& settings, const PreparedCapture* capture) {
  STGS_ASSIGN(const TrainingChoice choice, choose_training(settings));
  STGS_ASSIGN(const std::unique_ptr<TrainBackend> backend, make_backend(settings.backend));
  const auto silent = [](int, const std::string&) {};
  STGS_ASSIGN(const PerceptualTerm perceptual,
              PerceptualTerm::create(settings, choice.parameters, *backend, silent));
  const std::vector<Camera> cameras = capture == nullptr ? std::vector<Camera>() : capture->cameras;
  STGS_TRY(perceptual.check_sizes(cameras));
  if (!settings.resume.empty()) {
    STGS_ASSIGN(const Checkpoint checkpoint, read_checkpoint(settings.resume));
    STGS_TRY(check_same_run(settings.resume, checkpoint.fingerprint,
                            fingerprint_of(choice.parameters, settings)));
  }
  return backend->reserve(train_plan(choice, perceptual, cameras));
}

}  // namespace stgs::encoder
