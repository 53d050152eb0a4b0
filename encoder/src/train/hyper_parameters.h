// SPDX-License-Identifier: Apache-2.0
// Every number of the training schedule, by name. The paper gives few of them; the others are
// chosen by measurement on training cameras (tests/bench/RESULTS.md).
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "stgs/format/status.h"

namespace stgs::encoder {

struct HyperParameters {
  // Length and size.
  int iterations = 6000;
  int max_primitives = 80000;

  // Loss weights (paper 3.4; the w of L_reg are not given there).
  double weight_l1 = 0.8;
  double weight_ssim = 0.2;
  double weight_lifespan = 1e-3;    // L_t
  double weight_opacity = 1e-2;     // L_opacity, second stage only
  double weight_scale = 1e-2;       // L_scale, divided by the scene's radius
  double weight_normal = 0.0;       // L_n: smooths surfaces, gains no PSNR; 0: off (PGSR: 0.015)
  double weight_perceptual = 0.01;  // L_lpips, where there are weights for the network

  // Learning rates (Adam). Lengths are relative to the scene's extent, times in frames.
  double lr_position = 1.6e-4;
  double lr_position_final = 1.6e-6;
  double lr_velocity = 6.4e-3;
  double lr_velocity_final = 6.4e-5;
  double velocity_shrink = 8;  // |v| that a step takes off what lives long, in rates of velocity,
                               // or where that is more
  double velocity_share = 0.0625;  // this share of it; neither where velocity_shrink is 0
  double still_from = 0.94;        // long: seen, at full opacity, for over this share of the clip,
  double still_least = 28;         // and for over as many frames
  double lr_scale = 5e-3;
  double lr_rotation = 1e-3;
  double lr_opacity = 5e-2;
  double lr_sh0 = 2.5e-3;
  double lr_sh_rest = 1.25e-4;
  double lr_time = 1e-2;
  double lr_sigma = 5e-3;   // of log sigma
  double lr_radius = 5e-3;  // frames
  double lr_colour = 1e-3;  // per-camera affine colour
  // A step over R views, one a process: the rates but lr_colour times R^batch_rate, Adam's decay
  // factors to the power R^batch_memory.
  double batch_rate = 0.5;
  double batch_memory = 1;

  // Schedules, as shares of the iterations.
  int sh_degree = 3;
  double sh_step = 0.1;           // harmonics rise by a degree each such share
  double coarse_until = 0.25;     // half-size pictures up to here
  double stage1_until = 1.0 / 3;  // growth; then N is frozen (paper 3.2)
  double normal_from = 7.0 / 30;  // L_n is on from here (PGSR: 7,000 of 30,000)
  double densify_from = 0.03;
  double densify_until = 0.85;  // last replacement of the second stage
  int densify_interval = 100;   // iterations; less in runs of under 600, unless it is set
  int opacity_resets = 0;       // spread evenly over the first stage
  double plain_until = 0.5;     // growth where the densification is ablated (3DGS, 4DGS)
  double plain_prune = 0.005;   // prune_opacity there (3DGS)
  double plain_reset = 0.1;     // opacity resets there, one each such share (3DGS, 4DGS)

  // The perceptual loss.
  double perceptual_from = 0.0;  // share of the iterations
  int perceptual_patch = 256;    // pixels a side that it looks at in a step; 0: the whole picture

  // Densification. Gradients are of the loss by image position, in half image widths.
  double clone_gradient = 2e-4;
  double split_gradient = 4e-4;
  double split_scale = 0.01;    // larger ones split, smaller ones clone; share of the extent
  double growth_limit = 0.1;    // new primitives a step, share of those present
  double prune_opacity = 0.02;  // fainter ones make room; above 200,000 primitives 0.005
  double prune_scale = 0.5;     // larger than this share of the extent is removed
  double score_error = 1.0;     // lambda_e, on E scaled to [0,1]
  double score_opacity = 0.2;   // lambda_o
  double score_lifespan = 0.5;  // lambda_l
  double replace_limit = 0.05;  // replaced a step, share of N

  // Share of the primitives that a step leaves out, chosen anew for each: what only one camera
  // needs is not relied on (held-out views gain where there are many steps and primitives).
  double drop_share = 0.05;

  // Start.
  double initial_opacity = 0.5;
  double initial_opacity_dynamic = 0.5;
  double initial_scale = 0.8;    // of the distance to the neighbours
  double sigma_dynamic = 3.0;    // frames (paper 3.3)
  double sigma_static = 3.0;     // clip lengths (paper 3.3)
  double initial_radius = 1e-6;  // frames (paper 3.3)
  int seen_background =
      1;  // 1: behind the scene is what its views show there (scene_background); 0: black
  int velocity_times_f = 1;  // 1: v = f v_init keeps the measured motion; 0: v = v_init
};

// The values of a preset: fast, default or best.
Result<HyperParameters> preset_hyper_parameters(const std::string& preset);
// Sets one by name; the error lists the names.
Status set_hyper_parameter(HyperParameters& parameters, const std::string& name,
                           const std::string& value);
// Whether a run can be made of them; the error names the value and its limits.
Status check_hyper_parameters(const HyperParameters& parameters);
// All names with their values.
std::vector<std::pair<std::string, std::string>> list_hyper_parameters(
    const HyperParameters& parameters);

}  // namespace stgs::encoder
