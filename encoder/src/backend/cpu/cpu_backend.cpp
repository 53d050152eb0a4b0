// SPDX-License-Identifier: Apache-2.0
// The CPU training backend: every stage of a step in parallel, results independent of the number of
// threads.
#include <algorithm>
#include <cmath>
#include <utility>

#include "backend/backend.h"
#include "backend/cpu/blend_backward.h"
#include "backend/cpu/project_backward.h"
#include "backend/cpu/regularisers.h"
#include "backend/cpu/surface.h"
#include "perceptual/perceptual_loss.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster.h"
#include "train/adam.h"
#include "train/colour_correction.h"
#include "train/coupled_state.h"
#include "train/image_loss.h"
#include "train/normal_loss.h"

namespace stgs::encoder {
namespace {

constexpr std::size_t kBlock = 512;  // primitives updated together

class CpuBackend final : public TrainBackend {
 public:
  Status check_perceptual() const override { return {}; }
  Status reserve(const TrainPlan& plan) override {
    perceptual_ = plan.perceptual ? std::make_unique<PerceptualLoss>(*plan.perceptual) : nullptr;
    return {};
  }
  Status begin(TrainState& state) override {
    state_ = &state;
    return {};
  }
  Status step(const StepInput& input) override;
  Result<std::vector<StepOutput>> read() override {
    return std::exchange(outputs_, std::vector<StepOutput>());
  }
  Result<DensifyCounts> densify(const DensifyInput& input) override;
  std::size_t size() const override { return state_->size(); }
  Status synchronise() override { return {}; }
  std::string name() const override { return "cpu (" + vector_target() + ")"; }

 private:
  double evaluate_normals(const StepInput& input, const RasterSettings& settings);
  void update(const StepInput& input);
  void update_one(const StepInput& input, std::size_t splat);
  void gather(const StepInput& input, std::size_t splat);

  TrainState* state_ = nullptr;
  std::vector<StepOutput> outputs_;  // since the last read()
  // Kept from step to step for their memory.
  SplatFrame frame_;
  RasterOutput output_;
  Image shown_, d_shown_, error_;
  ImageLoss loss_;
  std::unique_ptr<PerceptualLoss> perceptual_;
  std::vector<cpu::SplatGradients> splat_gradients_;
  cpu::BlendBackwardScratch scratch_;
  cpu::PrimitiveGradients gradients_;
  // Where L_n is on.
  NormalLoss normal_loss_;
  RasterOutput surface_;
  Image d_surface_;
  std::vector<math::Plane> planes_, d_planes_;
};

// L_n, d_surface_ with it.
double CpuBackend::evaluate_normals(const StepInput& input, const RasterSettings& settings) {
  cpu::find_planes(state_->set, input.ticks, input.camera, frame_, planes_);
  cpu::blend_planes(settings, frame_, planes_, surface_);
  return normal_loss_.evaluate(surface_, *input.truth.pixels, input.camera, input.weight_normal,
                               d_surface_);
}

Status CpuBackend::step(const StepInput& input) {
  RasterSettings settings;
  settings.max_sh_degree = input.sh_degree;
  settings.background = input.background;
  begin_frame(input.camera, frame_);
  slice(state_->set, input.ticks, input.camera, settings, 0, frame_);
  if (input.drop_share > 0) {
    std::erase_if(frame_.splats, [&input](const Splat& splat) {
      return dropped(input.drop_random, input.drop_share, splat.id);
    });
  }
  bin(frame_);
  blend(frame_, settings, output_);

  apply_colour(state_->colour[input.colour_index], output_.colour, shown_);
  const ImageLossValue value = loss_.evaluate(
      shown_, *input.truth.pixels, {input.weight_l1, input.weight_ssim}, d_shown_, error_);
  StepOutput out;
  if (input.weight_perceptual > 0) {
    out.perceptual = perceptual_->evaluate(shown_, *input.truth.pixels, input.patch,
                                           input.weight_perceptual, d_shown_);
  }
  const ColourMap d_map =
      colour_backward(state_->colour[input.colour_index], output_.colour, d_shown_);
  const bool normals = input.weight_normal > 0.0f;
  if (normals) out.normal = evaluate_normals(input, settings);
  const cpu::PlanesBackward planes{planes_, d_surface_, d_planes_};
  cpu::blend_backward(frame_, settings, output_, d_shown_, &error_, scratch_, splat_gradients_,
                      normals ? &planes : nullptr);
  gradients_.with_covariance = state_->is_coupled();
  cpu::project_backward(state_->set, input.ticks, input.camera, settings, frame_, splat_gradients_,
                        gradients_);
  if (normals) {
    cpu::planes_backward(state_->set, input.ticks, input.camera, frame_, d_planes_, gradients_);
  }
  // With f = 1 the effective velocity is the learnt one.
  if (input.modulated) {
    cpu::modulation_backward(state_->set, frame_, gradients_);
  }
  out.loss = value.loss + cpu::regularisation_loss(*state_, frame_, input) +
             input.weight_normal * out.normal + input.weight_perceptual * out.perceptual;
  out.l1 = value.l1;
  out.ssim = value.ssim;
  out.visible = frame_.splats.size();
  update(input);
  update_colour(*state_, input.colour_index, d_map, input.rate_colour);
  outputs_.push_back(out);
  return {};
}

Result<DensifyCounts> CpuBackend::densify(const DensifyInput& input) {
  const DensifyCounts counts = input.refining ? replace(*state_, *input.parameters, input.context)
                                              : grow(*state_, *input.parameters, input.context);
  if (input.reset_opacity) reset_opacity(*state_);
  state_->derive_all(input.context.modulated);
  return counts;
}

void CpuBackend::update(const StepInput& input) {
  parallel_blocks(std::size_t{0}, frame_.splats.size(), kBlock,
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t s = first; s < last; ++s) {
                      if (input.gather_statistics) gather(input, s);
                      update_one(input, s);
                    }
                  });
}

// Statistics for densification; image positions in half image widths, so that one threshold fits
// every picture size (3DGS).
void CpuBackend::gather(const StepInput& input, std::size_t splat) {
  const std::uint32_t i = frame_.splats[splat].id;
  const cpu::SplatGradients& g = splat_gradients_[splat];
  const float half_width = 0.5f * input.camera.width;
  const float half_height = 0.5f * input.camera.height;
  DensifyStatistics& statistics = state_->statistics;
  statistics.gradient_sum[i] += std::hypot(g.mean.x * half_width, g.mean.y * half_height);
  statistics.abs_gradient_sum[i] +=
      std::hypot(g.abs_mean.x * half_width, g.abs_mean.y * half_height);
  statistics.error_max[i] = std::max(statistics.error_max[i], g.error);
  ++statistics.views[i];
}

void CpuBackend::update_one(const StepInput& input, std::size_t splat) {
  TrainState& state = *state_;
  const std::uint32_t i = frame_.splats[splat].id;
  // The covariance's gradient holds it already, and only the regulariser's is added here.
  if (state.is_coupled()) std::fill_n(&gradients_.log_scale[3 * splat], 3, 0.0f);
  cpu::regularise(state, frame_.splats.size(), i, input, gradients_.log_scale.data() + 3 * splat,
                  gradients_.opacity_logit[splat], gradients_.sigma[splat],
                  gradients_.radius[splat]);
  const float modulation =
      input.modulated ? math::lifespan_modulation(state.set.sigma[i], state.set.radius[i]) : 1.0f;
  const float d_log_sigma = gradients_.sigma[splat] * state.set.sigma[i];

  const AdamCorrection correction(++state.updates[i]);
  const auto apply = [&](int attribute, const float* gradient, std::size_t n, float rate,
                         std::size_t skip = 0) {
    const std::size_t at = i * static_cast<std::size_t>(state.components(attribute)) + skip;
    Moments& moments = state.moments[attribute];
    adam_step(state.values(attribute).data() + at, moments.first.data() + at,
              moments.second.data() + at, gradient, n, rate, correction);
  };
  if (state.is_coupled()) {
    const float* s = &gradients_.log_scale[3 * splat];
    const float* u = &gradients_.velocity[3 * splat];
    const math::Coupled by = coupled_backward(state, i,
                                              {gradients_.covariance[splat],
                                               {s[0], s[1], s[2]},
                                               {u[0], u[1], u[2]},
                                               gradients_.sigma[splat]});
    apply(kLogScale, &by.scale.x, 3, input.rates[kLogScale]);
    apply(kRotation, &by.left.w, 4, input.rates[kRotation]);
    apply(kVelocity, &by.right.w, 4, input.rates[kVelocity]);
    apply(kLogSigma, &by.time, 1, input.rates[kLogSigma]);
  } else {
    apply(kLogScale, gradients_.log_scale.data() + 3 * splat, 3, input.rates[kLogScale]);
    apply(kRotation, gradients_.rotation.data() + 4 * splat, 4, input.rates[kRotation]);
    apply(kVelocity, gradients_.velocity.data() + 3 * splat, 3, input.rates[kVelocity]);
    apply(kLogSigma, &d_log_sigma, 1, input.rates[kLogSigma]);
  }
  apply(kPosition, gradients_.position.data() + 3 * splat, 3, input.rates[kPosition]);
  apply(kOpacity, &gradients_.opacity_logit[splat], 1, input.rates[kOpacity]);
  apply(kTime, &gradients_.time[splat], 1, input.rates[kTime]);
  if (input.learn_radius) {
    apply(kRadius, &gradients_.radius[splat], 1, input.rates[kRadius]);
    state.set.radius[i] = std::max(state.set.radius[i], 0.0f);
  }
  const std::size_t sh = std::size_t{3} * gradients_.sh_coefficients;
  apply(kSh, gradients_.sh.data() + sh * splat, 3, input.rate_sh0);
  if (sh > 3) apply(kSh, gradients_.sh.data() + sh * splat + 3, sh - 3, input.rates[kSh], 3);
  if (input.modulated && !state.is_coupled()) state.carry_motion(i, modulation);
  state.derive(i, input.modulated);
}

}  // namespace

std::unique_ptr<TrainBackend> make_cpu_backend() {
  return std::make_unique<CpuBackend>();
}

}  // namespace stgs::encoder
