// SPDX-License-Identifier: Apache-2.0
// The end of the step for each visible primitive, a thread each: its instances' sums, the gradients
// by its parameters (math/grad.h), regularisers, densification statistics, Adam. The harmonics,
// most of the numbers, are then updated by the whole warp so that memory is read in rows.
#include "backend/cuda/device.cuh"
#include "math/grad.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kWarps = kUpdateBlock / 32;
// Instances of a splat that its thread adds up alone; more are shared by the warp.
constexpr std::uint32_t kAlone = 6;
// sqrt(-2 ln o_th): the factor of sigma in L_t, as the paper writes it.
constexpr float kSpanFactor = 3.32904297f;

struct Sums {
  float v[kSums];
};

__device__ void add_instance(const float* partials, std::uint32_t instance, Sums& sums) {
  const float4* p = reinterpret_cast<const float4*>(partials) + std::size_t{3} * instance;
#pragma unroll
  for (int q = 0; q < 3; ++q) {
    const float4 x = __ldg(p + q);
    sums.v[4 * q] += x.x;
    sums.v[4 * q + 1] += x.y;
    sums.v[4 * q + 2] += x.z;
    sums.v[4 * q + 3] += x.w;
  }
}

// The lanes' sums over their instances, in an order that the numbers of instances alone decide.
__device__ Sums sum_instances(uint2 range, const float* partials) {
  const int lane = threadIdx.x & 31;
  Sums own{};
  if (range.y <= kAlone) {
    for (std::uint32_t k = 0; k < range.y; ++k) add_instance(partials, range.x + k, own);
  }
  unsigned large = __ballot_sync(kAllLanes, range.y > kAlone);
  while (large != 0) {
    const int owner = __ffs(large) - 1;
    large &= large - 1;
    const std::uint32_t begin = __shfl_sync(kAllLanes, range.x, owner);
    const std::uint32_t count = __shfl_sync(kAllLanes, range.y, owner);
    Sums part{};
    for (std::uint32_t k = lane; k < count; k += 32) add_instance(partials, begin + k, part);
#pragma unroll
    for (int q = 0; q < kSums; ++q) {
      const float sum = warp_sum(part.v[q]);
      if (lane == owner) own.v[q] = sum;
    }
  }
  return own;
}

// Gradients by a splat, from the sums over its pixels.
struct SplatGradient {
  Vec2 mean;
  Sym2 conic;
  Vec3 colour;
  float opacity;  // by O_t
  Vec2 abs_mean;
  float error;
};

__device__ SplatGradient splat_gradient(const Sums& s, Sym2 conic, float opacity) {
  const float gx = s.v[5], gy = s.v[6];
  SplatGradient g;
  g.colour = {s.v[0], s.v[1], s.v[2]};
  g.error = s.v[3];
  g.opacity = -s.v[4] / opacity;
  g.mean = {-(conic.xx * gx + conic.xy * gy), -(conic.xy * gx + conic.yy * gy)};
  g.conic = {0.5f * s.v[7], s.v[8], 0.5f * s.v[9]};
  g.abs_mean = {s.v[10] / kLog2E, s.v[11] / kLog2E};
  return g;
}

// What a primitive's thread leaves for its warp: gradients by the parameters but for the harmonics,
// whose gradients are basis times colour gradient, and Adam's factors.
enum Field : int {
  kByPosition = 0,
  kByLogScale = 3,
  kByRotation = 6,
  kByOpacity = 10,
  kByTime = 11,
  kByVelocity = 12,  // the new v after Adam
  kByLogSigma = 15,  // the new log sigma after Adam
  kByRadius = 16,    // the new r after Adam
  kByColour = 17,
  kBasis = 20,
  kFirstFactor = 36,
  kSecondRoot = 37,
  kFields = 39,  // odd, so that lanes fall on different banks
};

__device__ void write3(float* to, Vec3 v) {
  to[0] = v.x;
  to[1] = v.y;
  to[2] = v.z;
}

// The gradient by the position seen, through the colour; basis and gradient for the harmonics.
__device__ Vec3 colour_backward(const float* sh, int coefficients, Vec3 from_camera,
                                const ScreenSplat& splat, Vec3 grad, float* stage) {
  // A channel that the forward clamps at 0 is 0, and passes nothing.
  if (!(splat.red > 0.0f)) grad.x = 0.0f;
  if (!(splat.green > 0.0f)) grad.y = 0.0f;
  if (!(splat.blue > 0.0f)) grad.z = 0.0f;
  const float inverse_length = 1.0f / sqrtf(dot3(from_camera, from_camera));
  const Vec3 direction = vec3_scale(from_camera, inverse_length);
  const ShBasis basis = sh_basis(direction);
  ShBasis by_basis{};
#pragma unroll
  for (int k = 0; k < kShMaxCoefficients; ++k) {
    if (k >= coefficients) break;
    stage[kBasis + k] = basis.v[k];
    by_basis.v[k] = sh[3 * k] * grad.x + sh[3 * k + 1] * grad.y + sh[3 * k + 2] * grad.z;
  }
  write3(stage + kByColour, grad);
  if (coefficients == 1) return {0.0f, 0.0f, 0.0f};
  return normalise_grad(direction, inverse_length, sh_basis_grad(direction, by_basis));
}

__device__ Vec3 read3(const float* array, std::uint32_t i) {
  return {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

// Image positions in half image widths, so that one threshold fits every picture size.
__device__ void gather_statistics(const Primitives& p, std::uint32_t i, const View& view,
                                  const SplatGradient& g) {
  const float half_width = 0.5f * view.camera.width, half_height = 0.5f * view.camera.height;
  p.gradient_sum[i] += hypotf(g.mean.x * half_width, g.mean.y * half_height);
  p.abs_gradient_sum[i] += hypotf(g.abs_mean.x * half_width, g.abs_mean.y * half_height);
  p.error_max[i] = fmaxf(p.error_max[i], g.error);
  ++p.views[i];
}

// A primitive's own values, read before anything that waits.
struct Own {
  Vec3 position, log_scale, v, u;
  float4 rotation;
  float time, logit, sigma, radius;
};

__device__ Own load_own(const Primitives& p, std::uint32_t i) {
  Own own;
  own.position = read3(p.values[kPosition], i);
  own.log_scale = read3(p.values[kLogScale], i);
  own.v = read3(p.values[kVelocity], i);
  own.u = read3(p.u, i);
  own.rotation = reinterpret_cast<const float4*>(p.values[kRotation])[i];
  own.time = p.values[kTime][i];
  own.logit = p.values[kOpacity][i];
  own.sigma = p.sigma[i];
  own.radius = p.values[kRadius][i];
  return own;
}

// Fills the stage of a visible primitive; returns its weighted regularisers, not yet a mean.
__device__ float primitive_gradients(const Primitives& p, std::uint32_t i, const Own& own,
                                     const View& view, const UpdateSettings& settings,
                                     const ScreenSplat& splat, const Sums& sums, float share,
                                     float* stage) {
  const Sym2 conic{splat.half_xx * (-2.0f / kLog2E), splat.cross * (-1.0f / kLog2E),
                   splat.half_yy * (-2.0f / kLog2E)};
  const float seen = exp2f(splat.most);  // O_t
  const SplatGradient grad = splat_gradient(sums, conic, seen);

  const float dt = view.ticks - own.time;
  const float sigma = own.sigma, radius = own.radius;
  const Vec3 u = own.u;
  const Vec3 position = position_at(own.position, u, dt);
  const Vec3 log_scale = own.log_scale;
  const Vec3 scale{expf(log_scale.x), expf(log_scale.y), expf(log_scale.z)};
  const Quat rotation{own.rotation.x, own.rotation.y, own.rotation.z, own.rotation.w};
  const ProjectionGrad by_projection = project_gaussian_grad(
      view.camera, position, covariance_of(rotation, scale), conic, grad.mean, grad.conic);
  const CovarianceGrad by_covariance = covariance_grad(rotation, scale, by_projection.covariance);
  const Vec3 from_camera{position.x - view.centre.x, position.y - view.centre.y,
                         position.z - view.centre.z};
  const Vec3 by_colour = colour_backward(p.values[kSh] + std::size_t{3} * p.sh_coefficients * i,
                                         view.coefficients, from_camera, splat, grad.colour, stage);
  const MotionGrad by_motion = position_at_grad(u, dt, vec3_add(by_projection.position, by_colour));
  const float opacity = opacity_of(own.logit);
  const VisibilityGrad by_visibility = visibility_grad(dt, sigma, radius, grad.opacity * opacity);
  VelocityGrad by_velocity{by_motion.u, 0.0f, 0.0f};
  if (settings.modulated) by_velocity = effective_velocity_grad(own.v, sigma, radius, by_motion.u);

  // L_t, L_opacity and L_scale (regularisers.cpp); l(t) of L_opacity is held constant.
  const float span = kSpanFactor * sigma + radius;
  const float d_span = -settings.weight_lifespan * share / (span * span);
  const float opacity_weight = settings.second_stage ? settings.weight_opacity : 0.0f;
  const float visible_share = visibility(dt, sigma, radius);
  float d_logit = grad.opacity * (seen / opacity) * opacity_grad(opacity) +
                  opacity_weight * share * visible_share * opacity * (1.0f - opacity);
  Vec3 d_scale{by_covariance.scale.x * scale.x, by_covariance.scale.y * scale.y,
               by_covariance.scale.z * scale.z};
  const bool first_is_least = log_scale.x <= log_scale.y && log_scale.x <= log_scale.z;
  const float least = smaller(scale.x, smaller(scale.y, scale.z));
  const float d_least = settings.weight_scale * share * least;
  if (first_is_least) {
    d_scale.x += d_least;
  } else if (log_scale.y <= log_scale.z) {
    d_scale.y += d_least;
  } else {
    d_scale.z += d_least;
  }
  const float d_sigma = by_visibility.sigma + by_velocity.sigma + kSpanFactor * d_span;
  const float d_radius = by_visibility.radius + by_velocity.radius + d_span;
  const float regularisers = settings.weight_lifespan / span +
                             opacity_weight * opacity * visible_share +
                             settings.weight_scale * least;

  write3(stage + kByPosition, by_motion.position);
  write3(stage + kByLogScale, d_scale);
  stage[kByRotation] = by_covariance.rotation.w;
  stage[kByRotation + 1] = by_covariance.rotation.x;
  stage[kByRotation + 2] = by_covariance.rotation.y;
  stage[kByRotation + 3] = by_covariance.rotation.z;
  stage[kByOpacity] = d_logit;
  stage[kByTime] = -(by_motion.dt + by_visibility.dt);
  write3(stage + kByVelocity, by_velocity.v);
  stage[kByLogSigma] = d_sigma * sigma;
  stage[kByRadius] = settings.learn_radius ? d_radius : radius;
  const AdamFactors factors = adam_factors(++p.updates[i]);
  stage[kFirstFactor] = factors.first;
  stage[kSecondRoot] = factors.second_root;
  if (settings.gather_statistics) gather_statistics(p, i, view, grad);
  return regularisers;
}

// The rows of an attribute's values and moments that belong to a warp's primitives: lane L has the
// values L, L + 32, ... of the kSize * 32 from the first on.
template <int kSize>
struct Rows {
  float value[kSize], first[kSize], second[kSize];
};

// Whether the value `e` of the warp's rows belongs to a visible primitive.
template <int kSize>
__device__ bool is_used(unsigned visible, int j) {
  return visible >> ((static_cast<int>(threadIdx.x & 31) + 32 * j) / kSize) & 1u;
}

template <int kSize>
__device__ void load_rows(const Primitives& p, int attribute, std::uint32_t first, unsigned visible,
                          Rows<kSize>& rows) {
  const std::size_t at = static_cast<std::size_t>(first) * kSize + (threadIdx.x & 31);
#pragma unroll
  for (int j = 0; j < kSize; ++j) {
    if (!is_used<kSize>(visible, j)) continue;
    rows.value[j] = p.values[attribute][at + 32 * j];
    rows.first[j] = p.first[attribute][at + 32 * j];
    rows.second[j] = p.second[attribute][at + 32 * j];
  }
}

// Adam on the rows, whose gradients are in the stage at `field`; the new values replace them there.
template <int kSize>
__device__ void step_rows(const Primitives& p, int attribute, std::uint32_t first, unsigned visible,
                          float rate, float* stage, int field, Rows<kSize>& rows) {
  const std::size_t at = static_cast<std::size_t>(first) * kSize + (threadIdx.x & 31);
#pragma unroll
  for (int j = 0; j < kSize; ++j) {
    if (!is_used<kSize>(visible, j)) continue;
    const int e = static_cast<int>(threadIdx.x & 31) + 32 * j;
    float* own = stage + e / kSize * kFields;
    float& gradient = own[field + e % kSize];
    float value = adam(rows.value[j], rows.first[j], rows.second[j], gradient, rate,
                       {own[kFirstFactor], own[kSecondRoot]});
    if (attribute == kRadius) value = fmaxf(value, 0.0f);
    gradient = value;
    p.values[attribute][at + 32 * j] = value;
    p.first[attribute][at + 32 * j] = rows.first[j];
    p.second[attribute][at + 32 * j] = rows.second[j];
  }
}

// All attributes but the harmonics; reads go ahead of writes by half of them.
__device__ void update_parameters(const Primitives& p, std::uint32_t first, unsigned visible,
                                  const UpdateSettings& s, float* stage) {
  Rows<3> position, log_scale, velocity;
  Rows<4> rotation;
  Rows<1> opacity, time, log_sigma, radius;
  load_rows(p, kPosition, first, visible, position);
  load_rows(p, kLogScale, first, visible, log_scale);
  load_rows(p, kRotation, first, visible, rotation);
  step_rows(p, kPosition, first, visible, s.rates[kPosition], stage, kByPosition, position);
  step_rows(p, kLogScale, first, visible, s.rates[kLogScale], stage, kByLogScale, log_scale);
  step_rows(p, kRotation, first, visible, s.rates[kRotation], stage, kByRotation, rotation);
  load_rows(p, kOpacity, first, visible, opacity);
  load_rows(p, kTime, first, visible, time);
  load_rows(p, kVelocity, first, visible, velocity);
  load_rows(p, kLogSigma, first, visible, log_sigma);
  if (s.learn_radius) load_rows(p, kRadius, first, visible, radius);
  step_rows(p, kOpacity, first, visible, s.rates[kOpacity], stage, kByOpacity, opacity);
  step_rows(p, kTime, first, visible, s.rates[kTime], stage, kByTime, time);
  step_rows(p, kVelocity, first, visible, s.rates[kVelocity], stage, kByVelocity, velocity);
  step_rows(p, kLogSigma, first, visible, s.rates[kLogSigma], stage, kByLogSigma, log_sigma);
  if (s.learn_radius)
    step_rows(p, kRadius, first, visible, s.rates[kRadius], stage, kByRadius, radius);
}

// The derived u and sigma from what update_parameters left in the primitive's stage.
__device__ void derive(const Primitives& p, std::uint32_t i, bool modulated, const float* stage) {
  const float sigma = expf(stage[kByLogSigma]);
  const float f = modulated ? lifespan_modulation(sigma, stage[kByRadius]) : 1.0f;
  p.sigma[i] = sigma;
  p.u[3 * i] = stage[kByVelocity] / f;
  p.u[3 * i + 1] = stage[kByVelocity + 1] / f;
  p.u[3 * i + 2] = stage[kByVelocity + 2] / f;
}

// The harmonics of the warp's primitives, kAhead values a lane at a time.
__device__ void update_harmonics(const Primitives& p, std::uint32_t first, unsigned visible,
                                 int coefficients, const UpdateSettings& settings,
                                 const float* stage) {
  constexpr int kAhead = 6;
  const unsigned used = 3u * static_cast<unsigned>(coefficients), stored = 3u * p.sh_coefficients;
  const std::size_t origin = static_cast<std::size_t>(first) * stored;
  for (unsigned e = threadIdx.x & 31; e < 32 * used; e += 32 * kAhead) {
    Rows<kAhead> rows;
    std::size_t at[kAhead];
    float gradient[kAhead], rate[kAhead];
    const float* own[kAhead];
#pragma unroll
    for (int j = 0; j < kAhead; ++j) {
      const unsigned place = e + 32 * j, owner = place / used, k = place % used;
      own[j] = nullptr;
      if (owner >= 32 || !(visible >> owner & 1u)) continue;
      own[j] = stage + owner * kFields;
      at[j] = origin + owner * stored + k;
      rows.value[j] = p.values[kSh][at[j]];
      rows.first[j] = p.first[kSh][at[j]];
      rows.second[j] = p.second[kSh][at[j]];
      gradient[j] = own[j][kBasis + k / 3] * own[j][kByColour + k % 3];
      rate[j] = k < 3 ? settings.rate_sh0 : settings.rates[kSh];
    }
#pragma unroll
    for (int j = 0; j < kAhead; ++j) {
      if (own[j] == nullptr) continue;
      const float value = adam(rows.value[j], rows.first[j], rows.second[j], gradient[j], rate[j],
                               {own[j][kFirstFactor], own[j][kSecondRoot]});
      p.values[kSh][at[j]] = value;
      p.first[kSh][at[j]] = rows.first[j];
      p.second[kSh][at[j]] = rows.second[j];
    }
  }
}

__global__ void __launch_bounds__(kUpdateBlock, 6)
    update(const Primitives p, const View view, const UpdateSettings settings, const Workspace w) {
  __shared__ float stages[kUpdateBlock * kFields];
  __shared__ double sums[kWarps];
  if (w.counters->overflow != 0) return;  // the lists are empty: the step will be done again
  const int warp = threadIdx.x / 32, lane = threadIdx.x & 31;
  const std::uint32_t i = blockIdx.x * kUpdateBlock + threadIdx.x;
  float* stage = stages + threadIdx.x * kFields;
  float* warp_stage = stages + 32 * warp * kFields;
  const bool own = i < p.n && w.depth_keys[i] != kInvisible;
  const unsigned visible = __ballot_sync(kAllLanes, own);
  double regularisers = 0.0;
  if (visible != 0) {
    const float share = 1.0f / static_cast<float>(w.counters->visible);
    Own values{};
    ScreenSplat splat{};
    if (own) {
      values = load_own(p, i);
      splat = load_splat(w.splats, i);
    }
    const Sums found = sum_instances(own ? w.ranges[i] : make_uint2(0, 0), w.partials);
    if (own)
      regularisers = primitive_gradients(p, i, values, view, settings, splat, found, share, stage);
    __syncwarp();
    update_harmonics(p, i - lane, visible, view.coefficients, settings, warp_stage);
    update_parameters(p, i - lane, visible, settings, warp_stage);
    __syncwarp();
    if (own) derive(p, i, settings.modulated, stage);
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
  update<<<blocks_of(p.n, kUpdateBlock), kUpdateBlock, 0, stream>>>(p, view, settings, w);
}

}  // namespace stgs::encoder::cuda
