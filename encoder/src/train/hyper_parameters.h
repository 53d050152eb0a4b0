// SPDX-License-Identifier: Apache-2.0
// All numbers of the training schedule, by name. The paper specifies few of them; the others are
// tuned on training cameras (tests/bench/results.csv). Members are named as --set takes them.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "stgs/format/status.h"

namespace stgs::encoder {

// The table in hyper_parameters.cpp describes the members and states their ranges.
struct HyperParameters {
  // Length and size.
  int iterations = 7500;
  int max_primitives = 80000;

  // Loss weights (paper 3.4; the w of L_reg are not given there).
  double weight_l1 = 0.8;
  double weight_ssim = 0.2;
  double weight_lifespan = 1e-3;
  double weight_opacity = 1e-2;
  double weight_scale = 1e-2;
  double weight_normal = 0.015;
  double weight_perceptual = 0.01;

  // Learning rates (Adam). Lengths are relative to the scene's extent, times in frames.
  double lr_position = 1.6e-4;
  double lr_position_final = 1.6e-6;
  double lr_velocity = 6.4e-3;
  double lr_velocity_final = 6.4e-5;
  // Damping of long-lived primitives (math/damp.h): a step reduces |v| by velocity_shrink times the
  // velocity's learning rate, or by the fraction velocity_share of |v| if that is more. Off if
  // velocity_shrink is 0. A primitive is long-lived if it is visible, at full opacity, for more
  // than the fraction still_from of the clip and for more than still_least frames.
  double velocity_shrink = 8;
  double velocity_share = 0.0625;
  double still_from = 0.94;
  double still_least = 28;
  double lr_scale = 5e-3;
  double lr_rotation = 1e-3;
  double lr_opacity = 5e-2;
  double lr_sh0 = 2.5e-3;
  double lr_sh_rest = 1.25e-4;
  double lr_time = 1e-2;
  double lr_sigma = 5e-3;
  double lr_radius = 5e-3;
  double short_rate = 0.5;  // math/short_lived.h
  double lr_colour = 1e-3;
  // Refinement of the cameras.
  double lr_camera = 3e-3;
  double camera_pull = 0.7;
  double lr_timing = 0.1;
  // A step over R views, one per process, multiplies all rates except lr_colour, lr_camera and
  // lr_timing by R^batch_rate and raises Adam's decay factors to the power R^batch_memory.
  double batch_rate = 0.5;
  double batch_memory = 1;

  // Schedules, as fractions of the iterations.
  int sh_degree = 3;
  double sh_step = 0.1;
  double coarse_until = 0.25;
  double stage1_until = 1.0 / 3;
  double normal_from = 7.0 / 30;
  double densify_from = 0.03;
  double densify_until = 0.85;
  int densify_interval = 100;
  int opacity_resets = 0;
  // With --ablate densification or --method 4dgs:
  double plain_until = 0.5;
  double plain_prune = 0.005;
  double plain_reset = 0.1;

  // The perceptual loss.
  double perceptual_from = 0.0;
  int perceptual_patch = 256;

  // Densification. Gradients are of the loss with respect to image position in half image widths.
  double clone_gradient = 2e-4;
  double split_gradient = 4e-4;
  double split_scale = 0.01;
  double growth_limit = 0.1;
  double prune_opacity = 0.02;
  double prune_scale = 0.5;
  double score_error = 1.0;
  double score_opacity = 0.2;
  double score_lifespan = 0.5;
  double replace_limit = 0.05;

  // Compaction, the last part of a run: first primitives are removed, in rounds, then the rest is
  // trained with quantisation in the loop.
  double compact_share = 0.2;
  double compact_keep = 0.5;
  int compact_rounds = 16;
  double compact_prune_share = 0.3;
  double compact_moving = 0.5;
  double compact_quality = 80;
  double compact_rate = 3e-8;
  double compact_restart = 0.6;
  double compact_decay = 0.1;

  // Dropping discourages primitives that serve a single camera (held-out views improve in runs with
  // many steps and primitives).
  double drop_share = 0.05;

  // The splats.
  int kernel = 1;
  double min_scale = 0.5;

  // Initialisation.
  double initial_opacity = 0.5;
  double initial_opacity_dynamic = 0.2;
  double initial_scale = 0.8;
  double initial_scale_dynamic = 0.5;
  double sigma_dynamic = 3.0;
  double sigma_static = 3.0;
  double initial_radius = 1e-6;
  int seen_background = 1;
  int velocity_times_f = 1;
};

// Returns the values of a preset: fast, default or best. kUsage for another name.
Result<HyperParameters> preset_hyper_parameters(const std::string& preset);
// Sets a hyper-parameter by name. kUsage for an invalid value or, with a list of the names, for an
// unknown name.
Status set_hyper_parameter(HyperParameters& parameters, const std::string& name,
                           const std::string& value);
// Checks that every value is within its limits. kUsage names the first that is not, with its
// limits.
Status check_hyper_parameters(const HyperParameters& parameters);
// Lists all names with their values.
std::vector<std::pair<std::string, std::string>> list_hyper_parameters(
    const HyperParameters& parameters);

}  // namespace stgs::encoder
