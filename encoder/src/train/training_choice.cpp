// SPDX-License-Identifier: Apache-2.0
#include "train/training_choice.h"

#include <xxhash.h>

#include <algorithm>
#include <initializer_list>

#include "stgs/encoder/rate_parameters.h"
#include "stgs/encoder/windows.h"
#include "stgs/format/math/sh.h"
#include "train/checkpoint.h"
#include "train/densify_plan.h"
#include "train/method.h"
#include "train/rig.h"

namespace stgs::encoder {
namespace {

// Above this number faint primitives are worth retaining: +0.36 dB on held-out views with 400,000.
// With 200,000 the threshold makes no difference (tests/bench/results.csv).
constexpr int kManyPrimitives = 200'000;
constexpr double kManyPruneOpacity = 0.005;
// With a limit of the file: bytes of a primitive in it, between those of two captures (10 to 14);
// primitives to grow to, as a multiple of those that fit, and at least. Measured: workshop gains
// 0.2 to 0.6 dB, basketball 0.2 dB on training cameras with 3 to 5 times as many instead of 9.
constexpr double kPackedPrimitive = 12.0, kGrowth = 4.0;
constexpr int kFewPrimitives = 1000;
// Pixels per side of the images for which memory is planned if no camera is known.
constexpr int kUnknownSide = 16;

bool is_overridden(const TrainSettings& settings, const char* name) {
  return std::any_of(settings.overrides.begin(), settings.overrides.end(),
                     [name](const auto& set) { return set.first == name; });
}

struct Choice {
  const TrainSettings& settings;
  const HyperParameters& parameters;
  const Ablation& ablation;
};

// Hyper-parameters that have no effect under a condition. test_train_settings verifies
// completeness.
struct Unused {
  const char* condition;
  bool (*applies)(const Choice&);
  std::initializer_list<const char*> parameters;
};

const Unused kUnused[] = {
    {"unless --ablate densification or --method 4dgs is given",
     [](const Choice& c) { return c.ablation.densification != Densification::kPlain; },
     {"plain_until", "plain_prune", "plain_reset"}},
    {"with --method freetimegs",
     [](const Choice& c) { return c.ablation.densification == Densification::kRelocation; },
     {"clone_gradient", "growth_limit", "opacity_resets", "replace_limit", "score_error",
      "score_opacity", "score_lifespan", "split_gradient", "split_scale", "stage1_until"}},
    // The stages differ in L_opacity and in the densification.
    {"if weight_opacity is 0, with --ablate densification or --method 4dgs",
     [](const Choice& c) {
       return c.ablation.densification == Densification::kPlain && c.parameters.weight_opacity == 0;
     },
     {"stage1_until"}},
    {"with --ablate densification or --method 4dgs",
     [](const Choice& c) { return c.ablation.densification == Densification::kPlain; },
     {"densify_until", "growth_limit", "opacity_resets", "prune_opacity", "replace_limit",
      "score_error", "score_opacity", "score_lifespan", "split_gradient"}},
    {"with --ablate initialisation",
     [](const Choice& c) { return !c.ablation.initialisation; },
     {"initial_opacity_dynamic", "initial_scale_dynamic", "sigma_dynamic", "velocity_times_f"}},
    {"with --ablate representation or --method 4dgs",
     [](const Choice& c) { return !c.ablation.representation; },
     {"initial_radius", "lr_radius", "lr_velocity", "lr_velocity_final", "min_scale", "normal_from",
      "still_from", "still_least", "velocity_share", "velocity_shrink", "velocity_times_f",
      "weight_normal"}},
    {"if velocity_shrink is 0",
     [](const Choice& c) { return c.parameters.velocity_shrink == 0; },
     {"still_from", "still_least", "velocity_share"}},
    {"if lr_velocity is 0",
     [](const Choice& c) { return c.parameters.lr_velocity == 0; },
     {"lr_velocity_final", "still_from", "still_least", "velocity_share", "velocity_shrink"}},
    {"if lr_position is 0",
     [](const Choice& c) { return c.parameters.lr_position == 0; },
     {"lr_position_final"}},
    {"with --ablate lifespan or --method freetimegs",
     [](const Choice& c) { return !c.ablation.lifespan; },
     {"initial_radius", "lr_radius"}},
    {"with --ablate modulation or --method freetimegs",
     [](const Choice& c) { return !c.ablation.modulation; },
     {"velocity_times_f"}},
    {"if replace_limit is 0",
     [](const Choice& c) { return c.parameters.replace_limit == 0; },
     {"score_error", "score_opacity", "score_lifespan"}},
    {"if weight_normal is 0",
     [](const Choice& c) { return c.parameters.weight_normal == 0; },
     {"normal_from"}},
    {"with kernel=0",
     [](const Choice& c) { return c.parameters.kernel != math::kBandLimited; },
     {"min_scale"}},
    {"with --foreground",
     [](const Choice& c) { return c.settings.foreground; },
     {"seen_background"}},
    {"without --refine-cameras",
     [](const Choice& c) { return !c.settings.refine_cameras; },
     {"lr_camera", "camera_pull"}},
    {"without --refine-timing",
     [](const Choice& c) { return !c.settings.refine_timing; },
     {"lr_timing"}},
    {"without --perceptual-weights",
     [](const Choice& c) { return c.settings.perceptual_weights.empty(); },
     {"perceptual_from", "perceptual_patch", "weight_perceptual"}},
    {"if weight_perceptual is 0",
     [](const Choice& c) { return c.parameters.weight_perceptual == 0; },
     {"perceptual_from", "perceptual_patch"}},
    {"with --ablate representation or --method 4dgs",
     [](const Choice& c) { return !c.ablation.representation; },
     {"compact_share"}},
    {"if compact_share is 0, or with --ablate representation or --method 4dgs",
     [](const Choice& c) { return c.parameters.compact_share == 0 || !c.ablation.representation; },
     {"compact_keep", "compact_rounds", "compact_prune_share", "compact_moving", "compact_quality",
      "compact_rate", "compact_restart", "compact_decay"}},
    {"with --target-kbps, --target-size or --target-psnr, which decide it",
     [](const Choice& c) {
       return c.settings.target_kbps > 0 || c.settings.target_size > 0 ||
              c.settings.target_psnr > 0;
     },
     {"compact_keep"}},
    {"with --target-psnr, which has rounds of its own",
     [](const Choice& c) { return c.settings.target_psnr > 0; },
     {"compact_rounds"}},
    {"with --quality, which is the same",
     [](const Choice& c) { return c.settings.quality > 0; },
     {"compact_quality"}},
    {"if sh_degree is 0",
     [](const Choice& c) { return c.parameters.sh_degree == 0; },
     {"lr_sh_rest", "sh_step"}},
    {"with a single process",
     [](const Choice& c) { return c.settings.ranks == nullptr || c.settings.ranks->size() == 1; },
     {"batch_memory", "batch_rate"}}};

// Checks that each override and the perceptual loss's file have an effect.
Status check_used(const Choice& choice) {
  if (!choice.settings.perceptual_weights.empty() && choice.parameters.weight_perceptual == 0) {
    return usage_error(
        "--perceptual-weights has no effect if weight_perceptual is 0; remove one of them");
  }
  for (const auto& [name, value] : choice.settings.overrides) {
    for (const Unused& unused : kUnused) {
      const bool listed = std::find(unused.parameters.begin(), unused.parameters.end(), name) !=
                          unused.parameters.end();
      if (!listed || !unused.applies(choice)) continue;
      return usage_error("--set {}={} has no effect {}; remove it", name, value, unused.condition);
    }
  }
  return {};
}

}  // namespace

Result<TrainingChoice> choose_training(const TrainSettings& settings) {
  TrainingChoice choice;
  STGS_TRY(check_parameters<TrainParameters>(settings));
  STGS_ASSIGN(const Method method, method_from_name(settings.method));
  if (method != Method::kSharpTimeGs && !settings.ablate.empty()) {
    return usage_error("--ablate disables parts of sharptimegs; remove it or --method {}",
                       settings.method);
  }
  STGS_ASSIGN(choice.parameters, preset_hyper_parameters(settings.preset));
  apply_method(method, choice.parameters);
  if (settings.iterations > 0) choice.parameters.iterations = settings.iterations;
  if (settings.max_primitives > 0) choice.parameters.max_primitives = settings.max_primitives;
  if (settings.quality > 0) choice.parameters.compact_quality = settings.quality;
  STGS_TRY(check_limits(settings));
  for (const auto& [name, value] : settings.overrides) {
    STGS_TRY(set_hyper_parameter(choice.parameters, name, value));
  }
  STGS_TRY(check_hyper_parameters(choice.parameters));
  HyperParameters& p = choice.parameters;
  if (!is_overridden(settings, "densify_interval")) {
    p.densify_interval =
        std::min(p.densify_interval,
                 max_densify_interval(static_cast<int>(p.iterations * (1.0 - p.compact_share))));
  }
  if (!is_overridden(settings, "prune_opacity") && p.max_primitives > kManyPrimitives) {
    p.prune_opacity = std::min(p.prune_opacity, kManyPruneOpacity);
  }
  if (method == Method::kSharpTimeGs) {
    STGS_ASSIGN(choice.ablation, Ablation::from_names(settings.ablate));
  } else {
    choice.ablation = ablation_of(method);
  }
  STGS_TRY(check_used({settings, choice.parameters, choice.ablation}));
  // The coupled form has no steps to round to.
  if (!choice.ablation.representation) p.compact_share = 0;
  const bool limited =
      settings.target_kbps > 0 || settings.target_size > 0 || settings.target_psnr > 0;
  if (p.compact_share == 0 && (limited || settings.quality > 0)) {
    return usage_error("{} needs the compaction at the end of training; remove it or {}",
                       limited ? "a limit or target of the file" : "--quality",
                       method == Method::k4dgs          ? "--method 4dgs"
                       : method == Method::kFreeTimeGs  ? "add --set compact_share=0.2"
                       : choice.ablation.representation ? "compact_share=0"
                                                        : "--ablate representation");
  }
  return choice;
}

HyperParameters growth_parameters(const HyperParameters& parameters, const TrainSettings& settings,
                                  const PreparedCapture& capture) {
  HyperParameters out = parameters;
  if (!is_overridden(settings, "weight_normal")) out.weight_normal *= rig_sparsity(capture);
  const double limit = byte_limit(settings, capture.time_base, capture.frames);
  if (limit == 0 || settings.max_primitives > 0 || is_overridden(settings, "max_primitives"))
    return out;
  const double most = parameters.max_primitives;
  out.max_primitives = static_cast<int>(
      std::clamp(kGrowth * limit / kPackedPrimitive, std::min<double>(kFewPrimitives, most), most));
  return out;
}

Result<std::uint64_t> settings_id(const TrainSettings& settings) {
  STGS_ASSIGN(const TrainingChoice choice, choose_training(settings));
  STGS_ASSIGN(const std::unique_ptr<TrainBackend> backend,
              make_backend(settings.backend, settings.share.index));
  const auto silent = [](int, const std::string&) {};
  STGS_ASSIGN(const PerceptualTerm perceptual,
              PerceptualTerm::create(settings, choice.parameters, *backend, silent));
  Fingerprint entries = list_hyper_parameters(choice.parameters);
  entries.emplace_back("method", settings.method);
  entries.emplace_back("ablate", fmt::format("{}", fmt::join(choice.ablation.names(), ",")));
  entries.emplace_back("refine_cameras", settings.refine_cameras ? "yes" : "no");
  entries.emplace_back("refine_timing", settings.refine_timing ? "yes" : "no");
  entries.emplace_back("foreground", settings.foreground ? "yes" : "no");
  entries.emplace_back("max_seconds", fmt::format("{}", settings.max_seconds));
  entries.emplace_back("target_kbps", fmt::format("{}", settings.target_kbps));
  entries.emplace_back("target_size", fmt::format("{}", settings.target_size));
  entries.emplace_back("target_psnr", fmt::format("{}", settings.target_psnr));
  entries.emplace_back("perceptual weights", perceptual.fingerprint());
  const std::string text = fingerprint_text(entries);
  return XXH3_64bits(text.data(), text.size());
}

TrainPlan train_plan(const TrainingChoice& choice, const PerceptualTerm& perceptual,
                     const std::vector<Camera>& cameras) {
  TrainPlan plan;
  plan.primitives = static_cast<std::size_t>(choice.parameters.max_primitives);
  plan.sh_coefficients = math::sh_coefficients(choice.parameters.sh_degree);
  plan.width = plan.height = kUnknownSide;
  for (const Camera& camera : cameras) {
    if (camera.test) continue;
    plan.width = std::max(plan.width, camera.width);
    plan.height = std::max(plan.height, camera.height);
  }
  plan.coupled = !choice.ablation.representation;
  plan.rounding = choice.parameters.compact_share > 0;
  plan.normals = choice.parameters.weight_normal > 0 && !plan.coupled;
  perceptual.plan(plan);
  return plan;
}

Status check_training(const TrainSettings& settings, const PreparedCapture* capture) {
  STGS_ASSIGN(TrainingChoice choice, choose_training(settings));
  STGS_ASSIGN(const std::unique_ptr<TrainBackend> backend,
              make_backend(settings.backend, settings.share.index));
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
  if (capture != nullptr)
    choice.parameters = growth_parameters(choice.parameters, settings, *capture);
  return backend->reserve(train_plan(choice, perceptual, cameras));
}

}  // namespace stgs::encoder
