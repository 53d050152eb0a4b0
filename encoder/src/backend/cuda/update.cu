// SPDX-License-Identifier: Apache-2.0
// Updates each visible primitive, one thread each: gradients of its parameters (math/grad.h),
// regularisers, densification statistics, Adam. The SH coefficients, most of the numbers, are
// updated by the complete warp for coalesced access.
#include "backend/cuda/coupled.cuh"
#include "backend/cuda/rank_blocks.h"
#include "backend/cuda/splat_sums.cuh"
#include "backend/cuda/update_rows.cuh"
#include "math/grad.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kWarps = kUpdateBlock / 32;
// sqrt(-2 ln o_th): the factor of sigma in L_t, as in the paper.
constexpr float kSpanFactor = 3.32904297f;

// Returns the gradient of the position at t through the colour. Writes the basis and the colour
// gradient to the stage.
__device__ Vec3 colour_backward(const float* sh, int coefficients, Vec3 from_camera,
                                const ScreenSplat& splat, Vec3 grad, float* stage) {
  grad = unclamped(splat, grad);
  const float inverse_length = 1.0f / sqrtf(dot3(from_camera, from_camera));
  const Vec3 direction = vec3_scale(from_camera, inverse_length);
  const ShBasis basis = sh_basis(direction);
#pragma unroll
  for (int k = 0; k < kShMaxCoefficients; ++k) {
    if (k < coefficients) stage[kBasis + k] = basis.v[k];
  }
  write3(stage + kByColour, grad);
  return by_direction(sh, coefficients, direction, inverse_length, grad);
}

// Image positions are in half image widths, so that one threshold fits all image sizes.
__device__ Statistics statistics_of(const View& view, const SplatGradient& g) {
  const float half_width = 0.5f * view.camera.width, half_height = 0.5f * view.camera.height;
  return {hypotf(g.mean.x * half_width, g.mean.y * half_height),
          hypotf(g.abs_mean.x * half_width, g.abs_mean.y * half_height), g.error};
}

// A visible primitive: its values, its splat, and the sums of the backward blend.
struct VisiblePrimitive {
  PrimitiveValues values;
  ScreenSplat splat;
  Sums sums;
  Plane by_plane;  // gradient of its plane
};

// Gradients of a pose. `covariance` is the one in world space, of which `factors` are the gradients
// of the scales and the rotation.
struct PoseGradient {
  Vec3 position;
  Sym3 covariance;
  CovarianceGrad factors;
};

// `by_colour`: the gradient of the position through the colour.
template <bool kPlanes>
__device__ PoseGradient pose_gradient(const View& view, const VisiblePrimitive& own,
                                      const Pose& pose, const SplatShapeGrad& grad,
                                      Vec3 by_colour) {
  const ProjectionGrad by_projection =
      project_gaussian_grad(view.camera, pose.position, covariance_of(pose.rotation, pose.scale),
                            conic_of(own.splat.falloff), grad);
  PoseGradient out{vec3_add(by_projection.position, by_colour), by_projection.covariance,
                   covariance_grad(pose.rotation, pose.scale, by_projection.covariance)};
  if constexpr (kPlanes) {
    const PrimitivePlaneGrad by = primitive_plane_grad(view.camera, pose.position, pose.rotation,
                                                       own.values.log_scale, own.by_plane);
    Quat& rotation = out.factors.rotation;
    out.position = vec3_add(out.position, by.position);
    rotation = {rotation.w + by.rotation.w, rotation.x + by.rotation.x, rotation.y + by.rotation.y,
                rotation.z + by.rotation.z};
  }
  return out;
}

// L_t, L_opacity and L_scale of a primitive (regularisers.cpp); l(t) of L_opacity is held constant.
struct Regularisers {
  float sum;              // weighted, not yet divided by the count
  float d_span, d_logit;  // gradients
  float d_shortest;       // of the logarithm of the shortest scale
};

// `visible`: l(t).
__device__ Regularisers regularisers_of(const UpdateSettings& settings, const PrimitiveValues& own,
                                        Vec3 scale, float opacity, float visible,
                                        float inverse_count) {
  const float span = kSpanFactor * own.sigma + own.radius;
  const float opacity_weight = settings.second_stage ? settings.weight_opacity : 0.0f;
  const float shortest = smaller(scale.x, smaller(scale.y, scale.z));
  Regularisers out;
  out.sum = settings.weight_lifespan / span + opacity_weight * opacity * visible +
            settings.weight_scale * shortest;
  out.d_span = -settings.weight_lifespan * inverse_count / (span * span);
  out.d_logit = opacity_weight * inverse_count * visible * opacity * (1.0f - opacity);
  out.d_shortest = settings.weight_scale * inverse_count * shortest;
  return out;
}

// Returns `d_scale` with the gradient of the shortest scale added.
__device__ Vec3 add_to_shortest(Vec3 d_scale, Vec3 log_scale, float d_shortest) {
  const bool first_is_shortest = log_scale.x <= log_scale.y && log_scale.x <= log_scale.z;
  if (first_is_shortest) {
    d_scale.x += d_shortest;
  } else if (log_scale.y <= log_scale.z) {
    d_scale.y += d_shortest;
  } else {
    d_scale.z += d_shortest;
  }
  return d_scale;
}

// What primitive_gradients() finds besides the gradients.
struct PrimitiveTerms {
  float regularisers;     // weighted, not yet divided by the count
  Statistics statistics;  // if they are gathered
};

// Fills the stage of visible primitive i except the factors. `inverse_count`: of the visible
// primitives.
template <bool kPlanes, bool kCoupled>
__device__ PrimitiveTerms primitive_gradients(const Primitives& p, std::uint32_t i,
                                              const VisiblePrimitive& own, const View& view,
                                              const UpdateSettings& settings, float inverse_count,
                                              float* stage) {
  const float splat_opacity = exp2f(own.splat.peak);
  const SplatGradient grad = splat_gradient(own.sums, conic_of(own.splat.falloff), splat_opacity);
  const float sigma = own.values.sigma, radius = own.values.radius;
  const Vec3 log_scale = own.values.log_scale;
  const Pose pose = pose_of(own.values, view);
  const Vec3 from_camera{pose.position.x - view.centre.x, pose.position.y - view.centre.y,
                         pose.position.z - view.centre.z};
  const Vec3 by_colour =
      colour_backward(p.rendered.sh + std::size_t{3} * p.sh_coefficients * i, view.coefficients,
                      from_camera, own.splat, grad.colour, stage);
  const float opacity = opacity_of(own.values.logit);
  // The splat's opacity is proportional to l(t) and to O. It is rendered, so neither is 0.
  const float visible = visibility(pose.dt, sigma, radius);
  const float by_log_opacity = grad.opacity * splat_opacity;
  const PoseGradient by_pose = pose_gradient<kPlanes>(
      view, own, pose, shape_gradient(view, grad, splat_opacity, opacity * visible), by_colour);
  const MotionGrad by_motion = position_at_grad(own.values.u, pose.dt, by_pose.position);
  const VisibilityGrad by_visibility =
      visibility_grad(pose.dt, sigma, radius, by_log_opacity / visible);
  Vec3 by_velocity = by_motion.u;
  if (settings.modulated) by_velocity = effective_velocity_grad(sigma, radius, by_velocity);
  const Regularisers terms =
      regularisers_of(settings, own.values, pose.scale, opacity, visible, inverse_count);
  const Vec3 by_scale = by_pose.factors.scale, scale = pose.scale;
  Vec3 d_scale{by_scale.x * scale.x, by_scale.y * scale.y, by_scale.z * scale.z};
  // The covariance's gradient includes the scales already; only the regulariser is added here.
  if constexpr (kCoupled) d_scale = {0.0f, 0.0f, 0.0f};
  d_scale = add_to_shortest(d_scale, log_scale, terms.d_shortest);
  const float d_sigma = by_visibility.sigma + kSpanFactor * terms.d_span;

  write3(stage + kByPosition, by_motion.position);
  write3(stage + kByLogScale, d_scale);
  write4(stage + kByRotation, by_pose.factors.rotation);
  stage[kByOpacity] = by_log_opacity / opacity * opacity_grad(opacity) + terms.d_logit;
  stage[kByTime] = -(by_motion.dt + by_visibility.dt);
  if constexpr (kCoupled) {
    write_coupled(stage,
                  coupled_primitive_grad(load_coupled(p, i), p.tick, log_scale, pose.rotation,
                                         {by_pose.covariance, d_scale, by_motion.u, d_sigma}));
  } else {
    write3(stage + kByVelocity, by_velocity);
    stage[kByLogSigma] = d_sigma * sigma;
    stage[kByRadius] = settings.learn_radius ? by_visibility.radius + terms.d_span : radius;
  }
  return {terms.sum, settings.gather_statistics ? statistics_of(view, grad) : Statistics{}};
}

// Writes this view's contribution to primitive i, from its stage.
__device__ void write_contribution(const RankBlocks& blocks, std::uint32_t i, const float* stage,
                                   const Statistics& statistics) {
  float* row = rank_rows(blocks, blocks.own) + i;
#pragma unroll
  for (int k = 0; k < kBasis; ++k, row += blocks.stride) *row = stage[k];
  row[0] = statistics.gradient;
  row[blocks.stride] = statistics.abs_gradient;
  row[2 * blocks.stride] = statistics.error;
}

// kShared: writes the gradients to the rank's block and does not change the state.
template <bool kPlanes, bool kCoupled, bool kShared>
__global__ void __launch_bounds__(kUpdateBlock, kCoupled ? 4 : 6)
    update(const Primitives p, const View view, const UpdateSettings settings, const Workspace w,
           const RankBlocks blocks) {
  __shared__ float stages[kUpdateBlock * kFields];
  __shared__ double sums[kWarps];
  if (w.counters->overflow != 0) return;  // the lists are empty; the step will be retried
  const int warp = threadIdx.x / 32, lane = threadIdx.x & 31;
  const std::uint32_t i = blockIdx.x * kUpdateBlock + threadIdx.x;
  float* stage = stages + threadIdx.x * kFields;
  float* warp_stage = stages + 32 * warp * kFields;
  const bool own = i < p.n && w.depth_keys[i] != kInvisible && p.updates[i] != kFixed;
  const unsigned visible = __ballot_sync(kAllLanes, own);
  if constexpr (kShared) {
    if (i < p.n) rank_rows(blocks, blocks.own)[kVisibleRow * blocks.stride + i] = own ? 1.0f : 0.0f;
  }
  double regularisers = 0.0;
  if (visible != 0) {
    const float inverse_count = 1.0f / static_cast<float>(w.counters->visible);
    VisiblePrimitive primitive{};
    if (own) {
      primitive.values = load_values(p, i);
      primitive.splat = load_splat(w.splats, i);
    }
    if (own) {
      primitive.sums = load_sums(w, i);
      if constexpr (kPlanes) {
        const float4 sum = w.plane_sums[i];
        primitive.by_plane = {{sum.x, sum.y, sum.z}, sum.w};
      }
      const PrimitiveTerms terms = primitive_gradients<kPlanes, kCoupled>(
          p, i, primitive, view, settings, inverse_count, stage);
      regularisers = terms.regularisers;
      if constexpr (kShared) {
        write_contribution(blocks, i, stage, terms.statistics);
      } else {
        write_factors(p, i, ++p.updates[i], settings, AdamBetas(), stage);
        if (settings.gather_statistics) gather_statistics(p, i, terms.statistics);
      }
    }
    if constexpr (!kShared) {
      __syncwarp();
      // Basis times colour gradient.
      const auto sh_gradient = [warp_stage](unsigned owner, unsigned k) {
        const float* owner_stage = warp_stage + owner * kFields;
        return owner_stage[kBasis + k / 3] * owner_stage[kByColour + k % 3];
      };
      update_sh(p, i - lane, visible, view.coefficients, settings, warp_stage, sh_gradient);
      update_parameters<kCoupled>(p, i - lane, visible, settings, warp_stage);
      __syncwarp();
      if (!kCoupled && own)
        derive(p, i, settings, lifespan_modulation(primitive.values.sigma, primitive.values.radius),
               stage);
    }
  }
  regularisers = warp_sum(regularisers);
  if (lane == 0) sums[warp] = regularisers;
  __syncthreads();
  if (threadIdx.x != 0) return;
  double sum = 0.0;
  for (double s : sums) sum += s;
  w.regulariser_sums[blockIdx.x] = sum;
}

}  // namespace

void launch_update(const Primitives& p, const View& view, const UpdateSettings& settings,
                   const Workspace& w, cudaStream_t stream) {
  const bool coupled = p.tick > 0.0f;  // which excludes planes
  const auto kernel = coupled       ? update<false, true, false>
                      : view.planes ? update<true, false, false>
                                    : update<false, false, false>;
  kernel<<<blocks_of(p.n, kUpdateBlock), kUpdateBlock, 0, stream>>>(p, view, settings, w, {});
  if (coupled) launch_derive_coupled(p, stream);
}

void launch_contributions(const Primitives& p, const View& view, const UpdateSettings& settings,
                          const Workspace& w, const RankBlocks& blocks, cudaStream_t stream) {
  const auto kernel = p.tick > 0.0f ? update<false, true, true>
                      : view.planes ? update<true, false, true>
                                    : update<false, false, true>;
  kernel<<<blocks_of(p.n, kUpdateBlock), kUpdateBlock, 0, stream>>>(p, view, settings, w, blocks);
}

}  // namespace stgs::encoder::cuda
