// SPDX-License-Identifier: Apache-2.0
// The importance sums of train/importance.cpp for a view. Each warp processes 8x4 pixels of a tile
// as in blend.cu, with one splat per lane; each lane accumulates the sum of its splat.
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

using math::kAlphaMax;
using math::kTransmittanceMin;

constexpr int kWarps = 8;  // two columns of four

__global__ void __launch_bounds__(kWarps * 32)
    accumulate_importance(const View view, const Workspace w, unsigned long long* sums) {
  __shared__ ScreenSplat stages[kWarps][32];
  ScreenSplat(&stage)[32] = stages[threadIdx.x / 32];
  const int warp = threadIdx.x / 32, lane = threadIdx.x & 31;
  const int x0 = static_cast<int>(blockIdx.x) * kTile + warp % 2 * 8;
  const int y0 = static_cast<int>(blockIdx.y) * kTile + warp / 2 * 4;
  if (x0 >= view.width || y0 >= view.height) return;  // the entire warp; no block barrier follows
  const int x1 = min(x0 + 8, view.width), y1 = min(y0 + 4, view.height);
  const int x = x0 + lane % 8, y = y0 + lane / 8;
  const float px = static_cast<float>(x) + 0.5f, py = static_cast<float>(y) + 0.5f;
  const std::uint32_t tile = blockIdx.y * view.tiles_x + blockIdx.x;
  const std::uint32_t end = w.tile_begin[tile + 1];

  float transmittance = x < x1 && y < y1 ? 1.0f : 0.0f;
  for (std::uint32_t at = w.tile_begin[tile]; at < end; at += 32) {
    if (__all_sync(kAllLanes, transmittance <= kTransmittanceMin)) return;
    std::uint32_t primitive = 0;
    ScreenSplat own{};
    bool hit = false;
    if (at + lane < end) {
      primitive = w.list[at + lane];
      own = load_splat(w.splats, primitive);
      hit = ellipse_meets(own, static_cast<float>(x0) + 0.5f, static_cast<float>(x1) - 0.5f,
                          static_cast<float>(y0) + 0.5f, static_cast<float>(y1) - 0.5f);
    }
    unsigned hits = __ballot_sync(kAllLanes, hit);
    stage[lane] = own;
    __syncwarp();
    float own_sum = 0.0f;
    for (; hits != 0; hits &= hits - 1) {
      const int k = __ffs(hits) - 1;
      const float log2 = log2_alpha(stage[k], px - stage[k].mean.x, py - stage[k].mean.y);
      const bool contributes = transmittance > kTransmittanceMin && log2 >= kLog2Threshold;
      const float alpha = contributes ? fminf(kAlphaMax, exp2_fast(log2)) : 0.0f;
      const float weight = alpha * transmittance;
      transmittance *= 1.0f - alpha;
      const float sum = warp_sum(weight * weight);
      if (lane == k) own_sum = sum;
    }
    __syncwarp();
    const auto units =
        static_cast<unsigned long long>(own_sum * static_cast<float>(kImportanceOne));
    if (units > 0) atomicAdd(sums + primitive, units);
  }
}

}  // namespace

void launch_importance(const View& view, unsigned long long* sums, const Workspace& w,
                       cudaStream_t stream) {
  accumulate_importance<<<dim3(view.tiles_x, view.tiles_y), kWarps * 32, 0, stream>>>(view, w,
                                                                                      sums);
}

}  // namespace stgs::encoder::cuda
