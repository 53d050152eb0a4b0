// SPDX-License-Identifier: Apache-2.0
// Adam on the parameters of a warp's 32 primitives, one value per lane for coalesced access. Each
// primitive's thread has written its gradients to its stage (shared memory).
#pragma once

#include "backend/cuda/device.cuh"
#include "math/damp.h"
#include "stgs/format/math/quant.h"

namespace stgs::encoder::cuda {

// The stage of a primitive, written by its thread for its warp: the gradients of the parameters
// except SH, whose gradients are basis times colour gradient, and the factors of Adam and the
// rates.
enum Field : int {
  kByPosition = 0,
  kByLogScale = 3,
  kByRotation = 6,
  kByOpacity = 10,
  kByTime = 11,
  kByVelocity = 12,  // the new v after Adam
  kByLogSigma = 15,  // the new log sigma after Adam
  kByRadius = 16,    // the new r after Adam
  // The coupled form uses these instead of the last three; its left rotation is at kByRotation.
  kByRight = 12,
  kByLogTime = 16,
  kByColour = 17,
  kBasis = 20,
  kFirstFactor = 36,
  kSecondRoot = 37,
  kRateFactor = 38,
  kFields = 39,  // odd, to avoid bank conflicts between lanes
};

__device__ inline void write3(float* to, math::Vec3 v) {
  to[0] = v.x;
  to[1] = v.y;
  to[2] = v.z;
}

// Densification statistics of a primitive in a view.
struct Statistics {
  float gradient, abs_gradient, error;
};

__device__ inline void gather_statistics(const Primitives& p, std::uint32_t i,
                                         const Statistics& view) {
  p.gradient_sum[i] += view.gradient;
  p.abs_gradient_sum[i] += view.abs_gradient;
  p.error_max[i] = fmaxf(p.error_max[i], view.error);
  ++p.views[i];
}

// An attribute's values and moments of a warp's primitives: lane L holds the values L, L + 32, ...
// of the kSize * 32, starting at the first.
template <int kSize>
struct Rows {
  float value[kSize], first[kSize], second[kSize];
};

// Returns whether row j of this lane belongs to a visible primitive.
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

// Writes the factors of update number `updates` of primitive i to its stage.
__device__ inline void write_factors(const Primitives& p, std::uint32_t i, std::uint32_t updates,
                                     const UpdateSettings& settings, AdamBetas betas,
                                     float* stage) {
  const AdamFactors factors = adam_factors(updates, betas);
  stage[kFirstFactor] = factors.first;
  stage[kSecondRoot] = factors.second_root;
  stage[kRateFactor] =
      math::short_lived_factor(p.sigma[i], p.values[kRadius][i], settings.short_lived);
}

// Applies Adam to the rows. Reads the gradients from the stage at `field` and replaces them with
// the new values.
template <int kSize>
__device__ void step_rows(const Primitives& p, int attribute, std::uint32_t first, unsigned visible,
                          float rate, AdamBetas betas, float* stage, int field, Rows<kSize>& rows) {
  const std::size_t at = static_cast<std::size_t>(first) * kSize + (threadIdx.x & 31);
#pragma unroll
  for (int j = 0; j < kSize; ++j) {
    if (!is_used<kSize>(visible, j)) continue;
    const int e = static_cast<int>(threadIdx.x & 31) + 32 * j;
    float* own = stage + e / kSize * kFields;
    float& gradient = own[field + e % kSize];
    float value = adam(rows.value[j], rows.first[j], rows.second[j], gradient,
                       own[kRateFactor] * rate, {own[kFirstFactor], own[kSecondRoot]}, betas);
    if (attribute == kRadius) value = fmaxf(value, 0.0f);
    gradient = value;
    p.values[attribute][at + 32 * j] = value;
    p.first[attribute][at + 32 * j] = rows.first[j];
    p.second[attribute][at + 32 * j] = rows.second[j];
  }
}

// Updates all attributes except SH, in two halves with all loads of a half before its stores.
template <bool kCoupled>
__device__ void update_parameters(const Primitives& p, std::uint32_t first, unsigned visible,
                                  const UpdateSettings& s, float* stage,
                                  AdamBetas betas = AdamBetas()) {
  constexpr int kVelocityField = kCoupled ? kByRight : kByVelocity;
  constexpr int kSigmaField = kCoupled ? kByLogTime : kByLogSigma;
  const bool learn_radius = !kCoupled && s.learn_radius;
  Rows<3> position, log_scale;
  Rows<kCoupled ? 4 : 3> velocity;
  Rows<4> rotation;
  Rows<1> opacity, time, log_sigma, radius;
  load_rows(p, kPosition, first, visible, position);
  load_rows(p, kLogScale, first, visible, log_scale);
  load_rows(p, kRotation, first, visible, rotation);
  step_rows(p, kPosition, first, visible, s.rates[kPosition], betas, stage, kByPosition, position);
  step_rows(p, kLogScale, first, visible, s.rates[kLogScale], betas, stage, kByLogScale, log_scale);
  step_rows(p, kRotation, first, visible, s.rates[kRotation], betas, stage, kByRotation, rotation);
  load_rows(p, kOpacity, first, visible, opacity);
  load_rows(p, kTime, first, visible, time);
  load_rows(p, kVelocity, first, visible, velocity);
  load_rows(p, kLogSigma, first, visible, log_sigma);
  if (learn_radius) load_rows(p, kRadius, first, visible, radius);
  step_rows(p, kOpacity, first, visible, s.rates[kOpacity], betas, stage, kByOpacity, opacity);
  step_rows(p, kTime, first, visible, s.rates[kTime], betas, stage, kByTime, time);
  step_rows(p, kVelocity, first, visible, s.rates[kVelocity], betas, stage, kVelocityField,
            velocity);
  step_rows(p, kLogSigma, first, visible, s.rates[kLogSigma], betas, stage, kSigmaField, log_sigma);
  if (learn_radius)
    step_rows(p, kRadius, first, visible, s.rates[kRadius], betas, stage, kByRadius, radius);
}

// Damps v (math/damp.h; `before`: the modulation f before the step), then derives u and sigma, from
// the values that update_parameters left in the primitive's stage.
__device__ inline void derive(const Primitives& p, std::uint32_t i, const UpdateSettings& settings,
                              float before, const float* stage) {
  const float sigma = expf(stage[kByLogSigma]);
  p.sigma[i] = sigma;
  math::Vec3 v = read3(stage + kByVelocity, 0);
  const float radius = stage[kByRadius];
  const float modulation = math::lifespan_modulation(sigma, radius);
  v = math::damped_velocity(v, settings.modulated ? modulation / before : 1.0f, sigma, radius,
                            settings.damping);
  write3(p.values[kVelocity] + 3 * i, v);
  const float f = settings.modulated ? modulation : 1.0f;
  write3(p.u + 3 * i, {v.x / f, v.y / f, v.z / f});
}

// Returns the gradient of the rate by value k (coefficient then channel) of primitive i, in bits.
__device__ inline float rate_gradient(const Primitives& p, std::uint32_t i, unsigned k) {
  const int band = math::sh_band_of(static_cast<int>(k / 3));
  if (band == 0) return 0.0f;
  const RoundingSteps& steps = p.rules->tiers[p.tier[i]];
  const math::Vec3 by = math::colour_rate_grad(read3(p.values[kSh], i * p.sh_coefficients + k / 3),
                                               steps.luma_bits[band], steps.chroma_bits[band]);
  return k % 3 == 0 ? by.x : k % 3 == 1 ? by.y : by.z;
}

// Updates the SH coefficients of the warp's primitives, kBatch values per lane at a time.
// gradient_of(owner, k) returns the gradient of value k (coefficient then channel) of the warp's
// primitive `owner`.
template <typename GradientOf>
__device__ void update_sh(const Primitives& p, std::uint32_t first, unsigned visible,
                          int coefficients, const UpdateSettings& settings, const float* stage,
                          const GradientOf& gradient_of, AdamBetas betas = AdamBetas()) {
  constexpr int kBatch = 6;
  const unsigned used = 3u * static_cast<unsigned>(coefficients), stored = 3u * p.sh_coefficients;
  const std::size_t origin = static_cast<std::size_t>(first) * stored;
  for (unsigned e = threadIdx.x & 31; e < 32 * used; e += 32 * kBatch) {
    Rows<kBatch> rows;
    std::size_t at[kBatch];
    float gradient[kBatch], rate[kBatch];
    const float* own[kBatch];
#pragma unroll
    for (int j = 0; j < kBatch; ++j) {
      const unsigned index = e + 32 * j, owner = index / used, k = index % used;
      own[j] = nullptr;
      if (owner >= 32 || !(visible >> owner & 1u)) continue;
      own[j] = stage + owner * kFields;
      at[j] = origin + owner * stored + k;
      rows.value[j] = p.values[kSh][at[j]];
      rows.first[j] = p.first[kSh][at[j]];
      rows.second[j] = p.second[kSh][at[j]];
      gradient[j] = gradient_of(owner, k);
      rate[j] = k < 3 ? settings.rate_sh0 : settings.rates[kSh];
      if (settings.weight_rate > 0.0f)
        gradient[j] += settings.weight_rate * rate_gradient(p, first + owner, k);
    }
    // The rate reads all channels of a coefficient, which are in one batch.
    if (settings.weight_rate > 0.0f) __syncwarp();
#pragma unroll
    for (int j = 0; j < kBatch; ++j) {
      if (own[j] == nullptr) continue;
      const float value =
          adam(rows.value[j], rows.first[j], rows.second[j], gradient[j],
               own[j][kRateFactor] * rate[j], {own[j][kFirstFactor], own[j][kSecondRoot]}, betas);
      p.values[kSh][at[j]] = value;
      p.first[kSh][at[j]] = rows.first[j];
      p.second[kSh][at[j]] = rows.second[j];
    }
  }
}

}  // namespace stgs::encoder::cuda
