// SPDX-License-Identifier: Apache-2.0
// The second half of a step of several ranks: sums the contributions of the views, one thread per
// primitive, then applies Adam in rows as in the update of a single rank.
#include "backend/cuda/rank_blocks.h"
#include "backend/cuda/update_rows.cuh"
#include "math/grad.h"
#include "stgs/format/math/sh.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kShStride = 3 * kShMaxCoefficients + 1;  // odd, to avoid bank conflicts between lanes
static_assert(kStatisticsRow == kBasis && kVisibleRow == kStatisticsRow + 3);

__device__ bool any_overflow(const RankBlocks& blocks) {
  for (int r = 0; r < blocks.count; ++r) {
    if (rank_head(blocks, r)->record.overflow != 0) return true;
  }
  return false;
}

// Adds a view's contribution to primitive i: fields of the stage, and SH gradients, which are basis
// times colour gradient.
__device__ void add_view(const Primitives& p, std::uint32_t i, float4 centre_ticks,
                         int coefficients, const float* rows, std::uint32_t stride, float* stage,
                         float* sh) {
#pragma unroll
  for (int k = 0; k < kBasis; ++k) stage[k] += rows[k * stride + i];
  const Vec3 position = position_at(read3(p.rendered.position, i), read3(p.rendered.u, i),
                                    centre_ticks.w - p.values[kTime][i]);
  const Vec3 from_camera{position.x - centre_ticks.x, position.y - centre_ticks.y,
                         position.z - centre_ticks.z};
  const ShBasis basis =
      sh_basis(vec3_scale(from_camera, 1.0f / sqrtf(dot3(from_camera, from_camera))));
  const float red = rows[kByColour * stride + i], green = rows[(kByColour + 1) * stride + i],
              blue = rows[(kByColour + 2) * stride + i];
#pragma unroll
  for (int k = 0; k < kShMaxCoefficients; ++k) {
    if (k >= coefficients) break;
    sh[3 * k] += basis.v[k] * red;
    sh[3 * k + 1] += basis.v[k] * green;
    sh[3 * k + 2] += basis.v[k] * blue;
  }
}

// Fills the stage and the SH gradients of primitive i with the means over the views. Returns
// whether it is visible in any of them.
__device__ bool mean_gradients(const Primitives& p, std::uint32_t i, const RankViews& views,
                               int coefficients, const UpdateSettings& settings,
                               const RankBlocks& blocks, float* stage, float* sh) {
  for (int k = 0; k < kBasis; ++k) stage[k] = 0.0f;
  for (int k = 0; k < 3 * coefficients; ++k) sh[k] = 0.0f;
  bool visible = false;
  for (int r = 0; r < blocks.count; ++r) {
    const float* rows = rank_rows(blocks, r);
    if (rows[kVisibleRow * blocks.stride + i] == 0.0f) continue;
    visible = true;
    add_view(p, i, views.centre_ticks[r], coefficients, rows, blocks.stride, stage, sh);
    if (!settings.gather_statistics) continue;
    const float* rest = rows + kStatisticsRow * blocks.stride + i;
    gather_statistics(p, i, {rest[0], rest[blocks.stride], rest[2 * blocks.stride]});
  }
  const float factor = 1.0f / static_cast<float>(blocks.count);
  for (int k = 0; k < kBasis; ++k) stage[k] *= factor;
  for (int k = 0; k < 3 * coefficients; ++k) sh[k] *= factor;
  return visible;
}

template <bool kCoupled>
__global__ void __launch_bounds__(kUpdateBlock)
    apply(const Primitives p, const RankViews views, int coefficients,
          const UpdateSettings settings, AdamBetas betas, const RankBlocks blocks) {
  __shared__ float stages[kUpdateBlock * kFields];
  __shared__ float sh_gradients[kUpdateBlock * kShStride];
  if (any_overflow(blocks)) return;
  const int warp = threadIdx.x / 32, lane = threadIdx.x & 31;
  const std::uint32_t i = blockIdx.x * kUpdateBlock + threadIdx.x;
  float* stage = stages + threadIdx.x * kFields;
  float* warp_stage = stages + 32 * warp * kFields;
  float* sh = sh_gradients + threadIdx.x * kShStride;
  const float* warp_sh = sh_gradients + 32 * warp * kShStride;
  const bool own =
      i < p.n && mean_gradients(p, i, views, coefficients, settings, blocks, stage, sh);
  const unsigned visible = __ballot_sync(kAllLanes, own);
  if (visible == 0) return;
  float before = 1.0f;
  if (own) {
    write_factors(p, i, ++p.updates[i], settings, betas, stage);
    if (!kCoupled) {
      before = lifespan_modulation(p.sigma[i], p.values[kRadius][i]);
      if (!settings.learn_radius) stage[kByRadius] = p.values[kRadius][i];
    }
  }
  __syncwarp();
  const auto sh_gradient = [warp_sh](unsigned owner, unsigned k) {
    return warp_sh[owner * kShStride + k];
  };
  update_sh(p, i - lane, visible, coefficients, settings, warp_stage, sh_gradient, betas);
  update_parameters<kCoupled>(p, i - lane, visible, settings, warp_stage, betas);
  __syncwarp();
  if (!kCoupled && own) derive(p, i, settings, before, stage);
}

}  // namespace

void launch_apply(const Primitives& p, const RankViews& views, int coefficients,
                  const UpdateSettings& settings, AdamBetas betas, const RankBlocks& blocks,
                  cudaStream_t stream) {
  const bool coupled = p.tick > 0.0f;
  const auto kernel = coupled ? apply<true> : apply<false>;
  kernel<<<blocks_of(p.n, kUpdateBlock), kUpdateBlock, 0, stream>>>(p, views, coefficients,
                                                                    settings, betas, blocks);
  if (coupled) launch_derive_coupled(p, stream);
}

}  // namespace stgs::encoder::cuda
