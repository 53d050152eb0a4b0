// SPDX-License-Identifier: Apache-2.0
#include "hyper_parameters.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <type_traits>

#include "stgs/encoder/train.h"

namespace stgs::encoder {
namespace {

template <typename Parameters, typename Visit>
void for_each_parameter(Parameters& p, Visit visit) {
  visit("iterations", p.iterations);
  visit("max_primitives", p.max_primitives);
  visit("weight_l1", p.weight_l1);
  visit("weight_ssim", p.weight_ssim);
  visit("weight_perceptual", p.weight_perceptual);
  visit("weight_lifespan", p.weight_lifespan);
  visit("weight_opacity", p.weight_opacity);
  visit("weight_scale", p.weight_scale);
  visit("weight_normal", p.weight_normal);
  visit("lr_position", p.lr_position);
  visit("lr_position_final", p.lr_position_final);
  visit("lr_velocity", p.lr_velocity);
  visit("lr_velocity_final", p.lr_velocity_final);
  visit("velocity_shrink", p.velocity_shrink);
  visit("velocity_share", p.velocity_share);
  visit("still_from", p.still_from);
  visit("still_least", p.still_least);
  visit("lr_scale", p.lr_scale);
  visit("lr_rotation", p.lr_rotation);
  visit("lr_opacity", p.lr_opacity);
  visit("lr_sh0", p.lr_sh0);
  visit("lr_sh_rest", p.lr_sh_rest);
  visit("lr_time", p.lr_time);
  visit("lr_sigma", p.lr_sigma);
  visit("lr_radius", p.lr_radius);
  visit("lr_colour", p.lr_colour);
  visit("batch_rate", p.batch_rate);
  visit("batch_memory", p.batch_memory);
  visit("sh_degree", p.sh_degree);
  visit("sh_step", p.sh_step);
  visit("coarse_until", p.coarse_until);
  visit("stage1_until", p.stage1_until);
  visit("normal_from", p.normal_from);
  visit("densify_from", p.densify_from);
  visit("densify_until", p.densify_until);
  visit("densify_interval", p.densify_interval);
  visit("opacity_resets", p.opacity_resets);
  visit("plain_until", p.plain_until);
  visit("plain_prune", p.plain_prune);
  visit("plain_reset", p.plain_reset);
  visit("perceptual_from", p.perceptual_from);
  visit("perceptual_patch", p.perceptual_patch);
  visit("clone_gradient", p.clone_gradient);
  visit("split_gradient", p.split_gradient);
  visit("split_scale", p.split_scale);
  visit("growth_limit", p.growth_limit);
  visit("prune_opacity", p.prune_opacity);
  visit("prune_scale", p.prune_scale);
  visit("score_error", p.score_error);
  visit("score_opacity", p.score_opacity);
  visit("score_lifespan", p.score_lifespan);
  visit("replace_limit", p.replace_limit);
  visit("drop_share", p.drop_share);
  visit("seen_background", p.seen_background);
  visit("initial_opacity", p.initial_opacity);
  visit("initial_opacity_dynamic", p.initial_opacity_dynamic);
  visit("initial_scale", p.initial_scale);
  visit("sigma_dynamic", p.sigma_dynamic);
  visit("sigma_static", p.sigma_static);
  visit("initial_radius", p.initial_radius);
  visit("velocity_times_f", p.velocity_times_f);
}

template <typename T>
bool parse(const std::string& text, T& value) {
  const char* end = text.data() + text.size();
  const auto [stopped, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && stopped == end && std::isfinite(static_cast<double>(value)) &&
         value >= 0;
}

}  // namespace

Result<HyperParameters> preset_hyper_parameters(const std::string& preset) {
  HyperParameters p;
  if (preset == "default") return p;
  if (preset == "fast") {
    p.iterations = 3000;
    p.max_primitives = 40000;
    p.sh_degree = 2;
    p.drop_share = 0;
    return p;
  }
  if (preset == "best") {
    p.iterations = 30000;
    p.max_primitives = 200000;
    p.prune_opacity = 0.005;
    p.drop_share = 0.1;
    // Beyond stage1_until, because the additional growth that full-size images cause does not help
    // other views.
    p.coarse_until = 0.4;
    return p;
  }
  return usage_error("unknown preset '{}': use fast, default or best", preset);
}

Status set_hyper_parameter(HyperParameters& parameters, const std::string& name,
                           const std::string& value) {
  bool known = false;
  bool parsed = false, is_integer = false;
  std::string names;
  for_each_parameter(parameters, [&](const char* n, auto& target) {
    names += names.empty() ? n : fmt::format(", {}", n);
    if (name != n) return;
    known = true;
    parsed = parse(value, target);
    is_integer = std::is_integral_v<std::remove_reference_t<decltype(target)>>;
  });
  if (!known) return usage_error("unknown hyper-parameter '{}'; expected one of: {}", name, names);
  if (!parsed)
    return usage_error("--set {}={}: invalid value (expected {} >= 0)", name, value,
                       is_integer ? "an integer" : "a number");
  return {};
}

namespace {

struct Limits {
  const char* name;
  double min, max;
};

// Limits of the parameters that kAnyNumber does not cover.
constexpr Limits kLimits[] = {{"iterations", 1, 1e8},
                              {"max_primitives", 1, 2e8},
                              {"sh_degree", 0, 3},
                              {"densify_interval", 1, 1e8},
                              // Fractions of the run or of the primitives.
                              {"sh_step", 0, 1},
                              {"coarse_until", 0, 1},
                              {"stage1_until", 0, 1},
                              {"growth_limit", 0, 10},
                              {"replace_limit", 0, 1},
                              {"drop_share", 0, 0.9},
                              {"velocity_share", 0, 1},
                              {"opacity_resets", 0, 1e4},
                              // Switches.
                              {"seen_background", 0, 1},
                              {"velocity_times_f", 0, 1},
                              // Not 0, because rates decay exponentially.
                              {"lr_position_final", 1e-15, 1e3},
                              {"lr_velocity_final", 1e-15, 1e3},
                              // Not 0 or 1, whose logits are infinite.
                              {"initial_opacity", 0.001, 0.999},
                              {"initial_opacity_dynamic", 0.001, 0.999},
                              {"initial_scale", 1e-6, 1e6},
                              {"initial_radius", 0, 1e6},
                              {"sigma_dynamic", 0.001, 1e6},
                              {"sigma_static", 0.001, 1e6}};
constexpr Limits kAnyNumber = {"", 0, 1e9};

}  // namespace

Status check_hyper_parameters(const HyperParameters& p) {
  Status status;
  for_each_parameter(p, [&](const char* name, const auto& parameter) {
    const auto* const own =
        std::find_if(std::begin(kLimits), std::end(kLimits),
                     [&](const Limits& l) { return std::string_view(l.name) == name; });
    const Limits& limits = own == std::end(kLimits) ? kAnyNumber : *own;
    const auto value = static_cast<double>(parameter);
    if (status.ok() && !(value >= limits.min && value <= limits.max)) {
      status = usage_error("hyper-parameter {} is out of range (expected {} to {}, got {})", name,
                           limits.min, limits.max, value);
    }
  });
  return status;
}

std::vector<std::pair<std::string, std::string>> list_hyper_parameters(
    const HyperParameters& parameters) {
  std::vector<std::pair<std::string, std::string>> list;
  for_each_parameter(parameters, [&](const char* name, const auto& value) {
    list.emplace_back(name, fmt::format("{}", value));
  });
  return list;
}

std::vector<std::pair<std::string, std::string>> hyper_parameters(const std::string& preset) {
  const Result<HyperParameters> parameters = preset_hyper_parameters(preset);
  return parameters.ok() ? list_hyper_parameters(*parameters)
                         : std::vector<std::pair<std::string, std::string>>{};
}

}  // namespace stgs::encoder
