// SPDX-License-Identifier: Apache-2.0
#include "hyper_parameters.h"

#include <charconv>
#include <cmath>
#include <type_traits>

#include "stgs/encoder/train.h"
#include "stgs/format/parameter.h"
#include "train/method.h"

namespace stgs::encoder {
namespace {

// Limits of parameters whose value matters only relative to others.
constexpr double kMin = 0, kMax = 1e9;

// The table of HyperParameters. Rates that decay exponentially must not be 0, nor opacities 0 or 1,
// whose logits are infinite.
struct HyperParameterTable {
  template <typename Visit>
  static void for_each(Visit visit) {
    STGS_VISIT(visit, iterations, 1, 1e8, "Training views, one per step and process");
    STGS_VISIT(visit, max_primitives, 1, 2e8, "Maximum number of primitives");
    STGS_VISIT(visit, weight_l1, kMin, kMax, "Weight of L1 (paper 3.4)");
    STGS_VISIT(visit, weight_ssim, kMin, kMax, "Weight of 1 - SSIM (paper 3.4)");
    STGS_VISIT(visit, weight_perceptual, kMin, kMax,
               "Weight of L_lpips; needs the weights of the network");
    STGS_VISIT(visit, weight_lifespan, kMin, kMax, "Weight of L_t");
    STGS_VISIT(visit, weight_opacity, kMin, kMax, "Weight of L_opacity, in the second stage only");
    STGS_VISIT(visit, weight_scale, kMin, kMax,
               "Weight of L_scale, which is divided by the scene's radius");
    STGS_VISIT(visit, weight_normal, kMin, kMax,
               "Weight of L_n (PGSR: 0.015); the default fades to 0 for dense rigs");
    STGS_VISIT(visit, lr_position, kMin, kMax,
               "Learning rate of positions at the start, relative to the scene's extent");
    STGS_VISIT(visit, lr_position_final, 1e-15, 1e3, "Learning rate of positions at the end");
    STGS_VISIT(visit, lr_velocity, kMin, kMax,
               "Learning rate of velocities at the start, relative to the scene's extent");
    STGS_VISIT(visit, lr_velocity_final, 1e-15, 1e3, "Learning rate of velocities at the end");
    STGS_VISIT(
        visit, velocity_shrink, kMin, kMax,
        "Damping of long-lived primitives per step, times the velocity's learning rate; 0: none");
    STGS_VISIT(visit, velocity_share, 0, 1,
               "Least damping of long-lived primitives per step, as a fraction of |v|");
    STGS_VISIT(visit, still_from, kMin, kMax,
               "Long-lived: visible at full opacity for more than this fraction of the clip");
    STGS_VISIT(visit, still_least, kMin, kMax,
               "Long-lived: visible at full opacity for more than this time", "frames");
    STGS_VISIT(visit, lr_scale, kMin, kMax, "Learning rate of scales");
    STGS_VISIT(visit, lr_rotation, kMin, kMax, "Learning rate of rotations");
    STGS_VISIT(visit, lr_opacity, kMin, kMax, "Learning rate of opacities");
    STGS_VISIT(visit, lr_sh0, kMin, kMax, "Learning rate of SH of degree 0");
    STGS_VISIT(visit, lr_sh_rest, kMin, kMax, "Learning rate of SH above degree 0");
    STGS_VISIT(visit, lr_time, kMin, kMax, "Learning rate of times");
    STGS_VISIT(visit, lr_sigma, kMin, kMax, "Learning rate of log sigma");
    STGS_VISIT(visit, lr_radius, kMin, kMax, "Learning rate of lifespan radii", "frames");
    STGS_VISIT(
        visit, short_rate, 0, 10,
        "The learning rates of a primitive are multiplied by the length of the clip over that of "
        "its support, to this power, by at most 3; 0: all are equal");
    STGS_VISIT(visit, lr_colour, kMin, kMax, "Learning rate of the affine colour of each camera");
    STGS_VISIT(visit, lr_camera, kMin, kMax,
               "Refined cameras: learning rate of angles, of shifts over the distance and of the "
               "logarithm of focal lengths, at the start; times 4 of distortion, times 30 of "
               "vignetting",
               "radians");
    STGS_VISIT(
        visit, camera_pull, kMin, kMax,
        "Refined cameras: length by which each step shortens a correction, over the rate; from 1 "
        "on, none is made");
    STGS_VISIT(visit, lr_timing, kMin, kMax,
               "Refined timing: learning rate of time offsets at the start", "frames");
    STGS_VISIT(
        visit, batch_rate, kMin, kMax,
        "A step over R views multiplies all rates except lr_colour, lr_camera and lr_timing by R "
        "to this power");
    STGS_VISIT(visit, batch_memory, kMin, kMax,
               "A step over R views raises Adam's decay factors to R to this power");
    STGS_VISIT(visit, sh_degree, 0, 3, "SH degree");
    STGS_VISIT(visit, sh_step, 0, 1,
               "Interval after which the SH degree in use rises by one, as a fraction of the run");
    STGS_VISIT(visit, coarse_until, 0, 1, "Half-size images up to this fraction of the run");
    STGS_VISIT(visit, stage1_until, 0, 1,
               "End of growth, after which N is frozen (paper 3.2), as a fraction of the run");
    STGS_VISIT(visit, normal_from, kMin, kMax,
               "L_n is on from this fraction of the run (PGSR: 7,000 of 30,000)");
    STGS_VISIT(visit, densify_from, kMin, kMax, "Densification starts at this fraction of the run");
    STGS_VISIT(visit, densify_until, kMin, kMax,
               "Last replacement of the second stage, as a fraction of the run");
    STGS_VISIT(visit, densify_interval, 1, 1e8,
               "Interval between densifications; shorter in runs of under 750 iterations, unless "
               "it is set",
               "iterations");
    STGS_VISIT(visit, opacity_resets, 0, 1e4,
               "Number of opacity resets, spread evenly over the first stage");
    STGS_VISIT(
        visit, plain_until, kMin, kMax,
        "With --ablate densification or --method 4dgs: end of growth, as a fraction of the run");
    STGS_VISIT(visit, plain_prune, kMin, kMax,
               "With --ablate densification or --method 4dgs: prune_opacity");
    STGS_VISIT(visit, plain_reset, kMin, kMax,
               "With --ablate densification or --method 4dgs: interval between opacity resets, as "
               "a fraction of the run");
    STGS_VISIT(visit, perceptual_from, kMin, kMax,
               "The perceptual loss is on from this fraction of the run");
    STGS_VISIT(visit, perceptual_patch, kMin, kMax,
               "Side of the perceptual loss's patch; 0: the complete image", "pixels");
    STGS_VISIT(visit, clone_gradient, kMin, kMax,
               "Least gradient of the loss with respect to image position, in half image widths, "
               "to clone a primitive");
    STGS_VISIT(visit, split_gradient, kMin, kMax,
               "Least gradient of the loss with respect to image position, in half image widths, "
               "to split a primitive");
    STGS_VISIT(visit, split_scale, kMin, kMax,
               "Larger primitives split, smaller ones clone; times the extent");
    STGS_VISIT(visit, growth_limit, 0, 10, "New primitives per step, as a fraction of N");
    STGS_VISIT(
        visit, prune_opacity, kMin, kMax,
        "Fainter primitives are removed; at most 0.005 above 200,000 primitives, unless it is set");
    STGS_VISIT(visit, prune_scale, kMin, kMax,
               "Larger primitives are removed; times the extent, and more in the far background");
    STGS_VISIT(visit, score_error, kMin, kMax,
               "Weight lambda_e of the error, scaled to [0, 1], in the densification score");
    STGS_VISIT(visit, score_opacity, kMin, kMax,
               "Weight lambda_o of the opacity in the densification score");
    STGS_VISIT(visit, score_lifespan, kMin, kMax,
               "Weight lambda_l of the lifespan in the densification score");
    STGS_VISIT(visit, replace_limit, 0, 1, "Replacements per step, as a fraction of N");
    STGS_VISIT(visit, compact_share, 0, 0.9,
               "Compaction: last fraction of the iterations, in which the primitives that matter "
               "least are removed and the others are trained for packing; the fractions of a run "
               "above refer to the iterations before it");
    STGS_VISIT(visit, compact_keep, 0.001, 1, "Compaction: fraction of the primitives to keep");
    STGS_VISIT(visit, compact_rounds, 1, 100,
               "Compaction: maximum number of rounds of removal; each of several rounds removes at "
               "least a tenth");
    STGS_VISIT(visit, compact_prune_share, 0, 1,
               "Compaction: fraction of it in which primitives are removed");
    STGS_VISIT(visit, compact_moving, 0, 2,
               "Compaction: power of the inverse lifespan by which the importance of short-lived "
               "primitives is raised");
    STGS_VISIT(visit, compact_quality, 0, 100,
               "Compaction: quality for which the quantisation steps are chosen");
    STGS_VISIT(visit, compact_rate, kMin, kMax, "Compaction: weight of the rate, as loss per bit");
    STGS_VISIT(visit, compact_restart, 0, 1,
               "Compaction: learning rates restart as at this fraction of the run");
    STGS_VISIT(visit, compact_decay, 1e-6, 1,
               "Compaction: factor of the learning rates at its end");
    STGS_VISIT(visit, drop_share, 0, 0.9,
               "Fraction of the primitives that each step drops at random");
    STGS_VISIT(visit, kernel, 0, 1, "Kernel of the splats: 1, band-limited; 0, as in 3DGS");
    STGS_VISIT(visit, min_scale, 0, 10,
               "Smallest scale of a primitive, in the sharpest training image", "pixels");
    STGS_VISIT(visit, seen_background, 0, 1, "1: the background is estimated; 0: black");
    STGS_VISIT(visit, initial_opacity, 0.001, 0.999, "Opacity of static initial points");
    STGS_VISIT(visit, initial_opacity_dynamic, 0.001, 0.999, "Opacity of dynamic initial points");
    STGS_VISIT(visit, initial_scale, 1e-6, 1e6,
               "Scale of static initial points, times the distance to the neighbours");
    STGS_VISIT(visit, initial_scale_dynamic, 1e-6, 1e6,
               "Scale of dynamic initial points, times the distance to the neighbours");
    STGS_VISIT(visit, sigma_dynamic, 0.001, 1e6, "Sigma of dynamic initial points (paper 3.3)",
               "frames");
    STGS_VISIT(visit, sigma_static, 0.001, 1e6, "Sigma of static initial points (paper 3.3)",
               "clip lengths");
    STGS_VISIT(visit, initial_radius, 0, 1e6, "Lifespan radius of initial points (paper 3.3)",
               "frames");
    STGS_VISIT(visit, velocity_times_f, 0, 1,
               "1: v = f v_init, which preserves the measured motion; 0: v = v_init");
  }
};

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
    p.iterations = 3600;
    p.max_primitives = 40000;
    p.compact_keep = 0.8;
    p.sh_degree = 2;
    p.drop_share = 0;
    return p;
  }
  if (preset == "best") {
    p.iterations = 40000;
    p.max_primitives = 200000;
    p.compact_share = 0.35;
    p.compact_keep = 0.36;
    p.prune_opacity = 0.005;
    p.drop_share = 0.1;
    // With 0.5, held-out views lose 0.1 dB.
    p.short_rate = 0;
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
  HyperParameterTable::for_each([&](const Parameter& parameter, auto member) {
    names += names.empty() ? parameter.name : fmt::format(", {}", parameter.name);
    if (name != parameter.name) return;
    auto& target = member(parameters);
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

Status check_hyper_parameters(const HyperParameters& parameters) {
  Status status;
  HyperParameterTable::for_each([&](const Parameter& parameter, auto member) {
    const auto value = static_cast<double>(member(parameters));
    if (!status.ok() || parameter.accepts(value)) return;
    status = usage_error("hyper-parameter {} is out of range (expected {}, got {})", parameter.name,
                         parameter.range(), value);
  });
  return status;
}

std::vector<std::pair<std::string, std::string>> list_hyper_parameters(
    const HyperParameters& parameters) {
  std::vector<std::pair<std::string, std::string>> list;
  HyperParameterTable::for_each([&](const Parameter& parameter, auto member) {
    list.emplace_back(parameter.name, fmt::format("{}", member(parameters)));
  });
  return list;
}

std::vector<HyperParameter> hyper_parameters(const std::string& preset, const std::string& method) {
  Result<HyperParameters> parameters = preset_hyper_parameters(preset);
  const Result<Method> known = method_from_name(method);
  if (!parameters.ok() || !known.ok()) return {};
  apply_method(*known, *parameters);
  std::vector<HyperParameter> list;
  HyperParameterTable::for_each([&](const Parameter& parameter, auto member) {
    list.push_back({parameter, fmt::format("{}", member(*parameters))});
  });
  return list;
}

}  // namespace stgs::encoder
