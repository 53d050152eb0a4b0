// SPDX-License-Identifier: Apache-2.0
// The CPU training backend. All stages of a step run in parallel; results do not depend on the
// number of threads.
#include <algorithm>
#include <cmath>
#include <utility>

#include "backend/backend.h"
#include "backend/cpu/adam_primitive.h"
#include "backend/cpu/blend_backward.h"
#include "backend/cpu/block.h"
#include "backend/cpu/project_backward.h"
#include "backend/cpu/rank_step.h"
#include "backend/cpu/regularisers.h"
#include "backend/cpu/surface.h"
#include "math/scale_limit.h"
#include "perceptual/perceptual_loss.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster.h"
#include "stgs/format/raster_view.h"
#include "train/colour_correction.h"
#include "train/colour_inverse.h"
#include "train/coupled_state.h"
#include "train/image_loss.h"
#include "train/normal_loss.h"
#include "train/relocation.h"
#include "train/undo_lens.h"

namespace stgs::encoder {
namespace {

class CpuBackend final : public TrainBackend {
 public:
  Status join(Ranks& ranks) override {
    ranks_ = &ranks;
    return {};
  }
  Status check_perceptual() const override { return {}; }
  Status reserve(const TrainPlan& plan) override {
    state_ = nullptr;
    outputs_.clear();
    perceptual_ = plan.perceptual ? std::make_unique<PerceptualLoss>(plan.perceptual) : nullptr;
    return {};
  }
  Status begin(TrainState& state) override {
    state_ = &state;
    if (state.compaction.is_rounding()) rounded_ = state.set;
    round();
    return {};
  }
  Status step(const StepInput& input) override;
  Result<std::vector<StepOutput>> read() override {
    return std::exchange(outputs_, std::vector<StepOutput>());
  }
  Result<DensifyCounts> densify(const DensifyInput& input) override;
  std::size_t size() const override { return state_->size(); }
  Status synchronise() override { return {}; }
  std::size_t abandon() override { return 0; }
  Status limit_scales(std::span<const math::PinholeCamera> cameras, float pixels) override;
  Result<std::optional<std::vector<float>>> importance(
      std::span<const ImportanceView> views,
      const std::function<bool(double)>& should_continue) override {
    return view_importance(state_->set, views, should_continue);
  }
  std::string name() const override { return "cpu (" + vector_target() + ")"; }

 private:
  // A splat's gradients of learnt parameters that the set is derived from.
  struct Derived {
    math::Coupled by;
    float log_sigma;
  };

  // Returns the set that views render.
  const Gaussians4D& rendered() const {
    return state_->compaction.is_rounding() ? rounded_ : state_->set;
  }
  // Renews the rounded values, if the state is being rounded.
  void round();
  double evaluate_normals(const StepInput& input, const RasterSettings& settings);
  void update(const StepInput& input);
  const Image8& ground_truth_of(const StepInput& input) const;
  // Adds the regularisers. The result points into `derived` and this backend.
  cpu::LearntGradients learnt_gradients(const StepInput& input, std::size_t splat,
                                        Derived& derived);
  cpu::ViewStatistics statistics_of(const StepInput& input, std::size_t splat) const;
  // Completes a step of several ranks. `own` has this view's losses and colour map gradient.
  Status update_with_ranks(const StepInput& input, cpu::ViewContribution& own);

  Ranks* ranks_ = nullptr;  // null: alone
  TrainState* state_ = nullptr;
  Gaussians4D rounded_;
  std::vector<StepOutput> outputs_;  // since the last read()
  // Working memory, reused between steps.
  SplatFrame frame_;
  RasterOutput output_;
  Image8 without_lens_;
  Image corrected_, d_corrected_, error_;
  ImageLoss loss_;
  std::unique_ptr<PerceptualLoss> perceptual_;
  std::vector<cpu::SplatGradients> splat_gradients_;
  cpu::BlendBackwardScratch scratch_;
  cpu::PrimitiveGradients gradients_;
  // Used if L_n is on.
  NormalLoss normal_loss_;
  RasterOutput surface_;
  Image d_surface_;
  std::vector<math::Plane> planes_, d_planes_;
};

void CpuBackend::round() {
  if (!state_->compaction.is_rounding()) return;
  const CompactionState& compaction = state_->compaction;
  parallel_blocks(
      std::size_t{0}, state_->size(), cpu::kBlock, [&](std::size_t first, std::size_t last) {
        for (std::size_t i = first; i < last; ++i) {
          if (state_->is_fixed(i)) continue;  // has its values since begin()
          round_primitive(state_->set, compaction.rules, compaction.tier[i], i, rounded_);
        }
      });
}

// Returns L_n and fills d_surface_.
double CpuBackend::evaluate_normals(const StepInput& input, const RasterSettings& settings) {
  cpu::find_planes(rendered(), input.ticks, input.camera, frame_, planes_);
  cpu::blend_planes(settings, frame_, planes_, surface_);
  return normal_loss_.evaluate(surface_, ground_truth_of(input), input.camera, input.weight_normal,
                               d_surface_);
}

// Returns the training image, without the lens that this step undoes.
const Image8& CpuBackend::ground_truth_of(const StepInput& input) const {
  return is_pinhole(input.lens) ? *input.ground_truth.pixels : without_lens_;
}

Status CpuBackend::step(const StepInput& input) {
  if (!is_pinhole(input.lens))
    undo_lens(*input.ground_truth.pixels, input.camera, input.lens, without_lens_);
  RasterSettings settings;
  settings.max_sh_degree = input.sh_degree;
  settings.kernel = input.kernel;
  settings.background = input.background;
  if (input.background_is_mapped) {
    settings.background =
        before_colour_map(state_->colour[input.colour_index].data(), input.background);
  }
  begin_frame(input.camera, frame_);
  slice(rendered(), input.ticks, input.camera, settings, 0, frame_);
  if (input.drop_share > 0) {
    std::erase_if(frame_.splats, [&input](const Splat& splat) {
      return dropped(input.drop_random, input.drop_share, splat.id);
    });
  }
  bin(frame_);
  blend(frame_, settings, output_);

  apply_colour(state_->colour[input.colour_index], output_.colour, corrected_);
  const Image8& ground_truth = ground_truth_of(input);
  const ImageLossValue value = loss_.evaluate(
      corrected_, ground_truth, {input.weight_l1, input.weight_ssim}, d_corrected_, error_);
  StepOutput out;
  if (input.weight_perceptual > 0) {
    out.perceptual = perceptual_->evaluate(corrected_, ground_truth, input.patch,
                                           input.weight_perceptual, d_corrected_);
  }
  const UnmappedBackground unmapped{output_.transmittance, settings.background};
  const ColourMap d_map =
      colour_backward(state_->colour[input.colour_index], output_.colour, d_corrected_,
                      input.background_is_mapped ? &unmapped : nullptr);
  const bool normals = input.weight_normal > 0.0f;
  if (normals) out.normal = evaluate_normals(input, settings);
  const cpu::PlanesBackward planes{planes_, d_surface_, d_planes_};
  cpu::blend_backward(frame_, settings, output_, d_corrected_, &error_, scratch_, splat_gradients_,
                      normals ? &planes : nullptr);
  gradients_.with_covariance = state_->is_coupled();
  gradients_.with_camera = input.gather_camera;
  cpu::project_backward(rendered(), input.ticks, input.camera, settings, frame_, splat_gradients_,
                        gradients_);
  if (normals) {
    cpu::planes_backward(rendered(), input.ticks, input.camera, frame_, d_planes_, gradients_);
  }
  // With f = 1 the effective velocity is the learnt one.
  if (input.modulated) {
    cpu::modulation_backward(rendered(), frame_, gradients_);
  }
  out.loss = value.loss + cpu::regularisation_loss(rendered(), state_->updates, frame_, input) +
             input.weight_normal * out.normal + input.weight_perceptual * out.perceptual;
  out.l1 = value.l1;
  out.mse = value.mse;
  out.ssim = value.ssim;
  out.visible = frame_.splats.size();
  if (input.gather_camera) {
    out.camera = gradients_.camera;
    out.vignetting = vignetting_gradient(input.camera, output_.colour, d_corrected_);
  }
  if (ranks_ != nullptr) {
    cpu::ViewContribution own;
    own.output = out;
    own.by_colour_map = d_map;
    return update_with_ranks(input, own);
  }
  update(input);
  round();
  update_colour(*state_, input.colour_index, d_map, input.rate_colour);
  outputs_.push_back(out);
  return {};
}

Result<DensifyCounts> CpuBackend::densify(const DensifyInput& input) {
  const auto change = input.step == DensifyStep::kGrow      ? grow
                      : input.step == DensifyStep::kReplace ? replace
                                                            : relocate;
  const DensifyCounts counts = change(*state_, *input.parameters, input.context);
  if (input.reset_opacity) {
    reset_opacity(*state_, densify_rules(*input.parameters, input.context));
  }
  state_->derive_all(input.context.modulated);
  return counts;
}

Status CpuBackend::limit_scales(std::span<const math::PinholeCamera> cameras, float pixels) {
  TrainState& state = *state_;
  parallel_blocks(std::size_t{0}, state.size(), cpu::kBlock,
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t i = first; i < last; ++i) {
                      if (state.is_fixed(i)) continue;
                      const math::Vec3 position = raster::read3(state.set.position, i);
                      float rate = 0;
                      for (const math::PinholeCamera& camera : cameras)
                        rate = std::max(rate, math::sampling_rate(camera, position));
                      if (!(rate > 0)) continue;
                      const float least = std::log(pixels / rate);
                      for (int k = 0; k < 3; ++k) {
                        float& log_scale = state.set.log_scale[3 * i + k];
                        log_scale = std::max(log_scale, least);
                      }
                    }
                  });
  round();
  return {};
}

void CpuBackend::update(const StepInput& input) {
  parallel_blocks(std::size_t{0}, frame_.splats.size(), cpu::kBlock,
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t s = first; s < last; ++s) {
                      const std::uint32_t i = frame_.splats[s].id;
                      if (state_->is_fixed(i)) continue;
                      if (input.gather_statistics) {
                        cpu::gather_statistics(*state_, i, statistics_of(input, s));
                      }
                      Derived derived;
                      adam_primitive(*state_, i, learnt_gradients(input, s, derived), input);
                    }
                  });
}

Status CpuBackend::update_with_ranks(const StepInput& input, cpu::ViewContribution& own) {
  const cpu::ContributionLayout layout(*state_);
  own.resize(frame_.splats.size(), layout);
  parallel_blocks(
      std::size_t{0}, frame_.splats.size(), cpu::kBlock, [&](std::size_t first, std::size_t last) {
        for (std::size_t s = first; s < last; ++s) {
          const math::Vec3 colour = frame_.splats[s].colour;
          math::Vec3 by = splat_gradients_[s].colour;
          // A channel that the forward pass clamps at 0 has no gradient.
          if (!(colour.x > 0.0f)) by.x = 0.0f;
          if (!(colour.y > 0.0f)) by.y = 0.0f;
          if (!(colour.z > 0.0f)) by.z = 0.0f;
          Derived derived;
          own.ids[s] = frame_.splats[s].id;
          own.set(s, layout, learnt_gradients(input, s, derived), by, statistics_of(input, s));
        }
      });
  STGS_ASSIGN(const std::vector<cpu::ViewContribution> views,
              cpu::gather_contributions(*ranks_, layout, own));
  cpu::apply_contributions(*state_, rendered(), input, views);
  round();
  for (const cpu::ViewContribution& view : views) outputs_.push_back(view.output);
  return {};
}

// Image positions are in half image widths, so that one threshold fits all image sizes (3DGS).
cpu::ViewStatistics CpuBackend::statistics_of(const StepInput& input, std::size_t splat) const {
  const cpu::SplatGradients& g = splat_gradients_[splat];
  const float half_width = 0.5f * input.camera.width;
  const float half_height = 0.5f * input.camera.height;
  return {std::hypot(g.mean.x * half_width, g.mean.y * half_height),
          std::hypot(g.abs_mean.x * half_width, g.abs_mean.y * half_height), g.error};
}

cpu::LearntGradients CpuBackend::learnt_gradients(const StepInput& input, std::size_t splat,
                                                  Derived& derived) {
  const TrainState& state = *state_;
  const std::uint32_t i = frame_.splats[splat].id;
  cpu::PrimitiveGradients& g = gradients_;
  // The covariance's gradient includes the scales already; only the regulariser is added here.
  if (state.is_coupled()) std::fill_n(&g.log_scale[3 * splat], 3, 0.0f);
  cpu::regularise(rendered(), frame_.splats.size(), i, input, g.log_scale.data() + 3 * splat,
                  g.opacity_logit[splat], g.sigma[splat], g.radius[splat]);
  cpu::LearntGradients learnt;
  learnt.by[kPosition] = &g.position[3 * splat];
  learnt.by[kOpacity] = &g.opacity_logit[splat];
  learnt.by[kTime] = &g.time[splat];
  learnt.by[kRadius] = &g.radius[splat];
  learnt.by[kSh] = &g.sh[splat * 3 * static_cast<std::size_t>(g.sh_coefficients)];
  learnt.coefficients = g.sh_coefficients;
  if (state.is_coupled()) {
    const float* s = &g.log_scale[3 * splat];
    const float* u = &g.velocity[3 * splat];
    derived.by = coupled_backward(
        state, i, {g.covariance[splat], {s[0], s[1], s[2]}, {u[0], u[1], u[2]}, g.sigma[splat]});
    learnt.by[kLogScale] = &derived.by.scale.x;
    learnt.by[kRotation] = &derived.by.left.w;
    learnt.by[kVelocity] = &derived.by.right.w;
    learnt.by[kLogSigma] = &derived.by.time;
  } else {
    derived.log_sigma = g.sigma[splat] * state.set.sigma[i];
    learnt.by[kLogScale] = &g.log_scale[3 * splat];
    learnt.by[kRotation] = &g.rotation[4 * splat];
    learnt.by[kVelocity] = &g.velocity[3 * splat];
    learnt.by[kLogSigma] = &derived.log_sigma;
  }
  return learnt;
}

}  // namespace

std::unique_ptr<TrainBackend> make_cpu_backend() {
  return std::make_unique<CpuBackend>();
}

}  // namespace stgs::encoder
