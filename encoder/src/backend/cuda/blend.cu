// SPDX-License-Identifier: Apache-2.0
// Forward blending. Each warp renders 8x4 pixels of a tile independently. It loads the tile's list
// 32 splats at a time, one per lane, and processes only those whose ellipse intersects its pixels.
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

using math::kAlphaMax;
using math::kTransmittanceMin;

constexpr int kWarps = 8;  // two columns of four

// Assigns the segment indices up to those of the next tile to this tile, or to none.
__device__ void list_segments(std::uint32_t segment, std::uint32_t first, std::uint32_t end,
                              std::uint32_t tile, int lane, uint2* segments) {
  const std::uint32_t count = (end - first + kSegment - 1) / kSegment;
  const std::uint32_t next = first_segment(end, tile + 1);
  for (std::uint32_t s = lane; segment + s < next; s += 32)
    segments[segment + s] = s < count ? make_uint2(tile, s) : make_uint2(~0u, 0);
}

template <bool kPlanes>
__global__ void __launch_bounds__(kWarps * 32) blend(const View view, const Workspace w) {
  __shared__ ScreenSplat stage[kWarps][32];
  __shared__ float4 plane_stage[kWarps][kPlanes ? 32 : 1];
  const int warp = threadIdx.x / 32, lane = threadIdx.x & 31;
  const int x0 = static_cast<int>(blockIdx.x) * kTile + warp % 2 * 8;
  const int y0 = static_cast<int>(blockIdx.y) * kTile + warp / 2 * 4;
  if (x0 >= view.width || y0 >= view.height) return;  // the entire warp; no block barrier follows
  const int x = x0 + lane % 8, y = y0 + lane / 8;
  const bool inside = x < view.width && y < view.height;
  const float px = static_cast<float>(x) + 0.5f, py = static_cast<float>(y) + 0.5f;
  const float left = static_cast<float>(x0) + 0.5f, top = static_cast<float>(y0) + 0.5f;
  const float right = static_cast<float>(min(x0 + 8, view.width)) - 0.5f;
  const float bottom = static_cast<float>(min(y0 + 4, view.height)) - 0.5f;
  const std::uint32_t tile = blockIdx.y * view.tiles_x + blockIdx.x;
  const std::uint32_t first = w.tile_begin[tile], end = w.tile_begin[tile + 1];

  const std::uint32_t segment = first_segment(first, tile);
  if (warp == 0) list_segments(segment, first, end, tile, lane, w.segments);
  const std::size_t in_tile = (y & (kTile - 1)) * kTile + (x & (kTile - 1));

  float transmittance = 1.0f, red = 0.0f, green = 0.0f, blue = 0.0f;
  float4 surface{};
  std::uint32_t last = 0;
  bool done = !inside;
  ScreenSplat next{};
  float4 next_plane{};
  if (first + lane < end) {
    next = load_splat(w.splats, w.list[first + lane]);
    if (kPlanes) next_plane = __ldg(w.planes + w.list[first + lane]);
  }
  for (std::uint32_t at = first; at < end; at += 32) {
    if (__all_sync(kAllLanes, done)) break;
    if (at > first && (at - first) % kSegment == 0) {
      const std::size_t checkpoint =
          std::size_t{kTile * kTile} * (segment + (at - first) / kSegment) + in_tile;
      w.checkpoints[checkpoint] = make_float4(red, green, blue, transmittance);
      if (kPlanes) w.surface_checkpoints[checkpoint] = surface;
    }
    const bool hit = at + lane < end && ellipse_meets(next, left, right, top, bottom);
    unsigned hits = __ballot_sync(kAllLanes, hit);
    stage[warp][lane] = next;
    if constexpr (kPlanes) plane_stage[warp][lane] = next_plane;
    __syncwarp();
    if (at + 32 + lane < end) {
      next = load_splat(w.splats, w.list[at + 32 + lane]);
      if (kPlanes) next_plane = __ldg(w.planes + w.list[at + 32 + lane]);
    }
    while (hits != 0) {
      const int k = __ffs(hits) - 1;
      hits &= hits - 1;
      const ScreenSplat& s = stage[warp][k];
      const float log2 = log2_alpha(s, px - s.mean.x, py - s.mean.y);
      if (done || log2 < kLog2Threshold) continue;
      const float alpha = fminf(kAlphaMax, exp2_fast(log2));
      const float after = transmittance * (1.0f - alpha);
      if (after < kTransmittanceMin) {
        done = true;
        continue;
      }
      const float weight = alpha * transmittance;
      red = fmaf(weight, s.colour.x, red);
      green = fmaf(weight, s.colour.y, green);
      blue = fmaf(weight, s.colour.z, blue);
      if constexpr (kPlanes) {
        const float4& plane = plane_stage[warp][k];
        surface.x = fmaf(weight, plane.x, surface.x);
        surface.y = fmaf(weight, plane.y, surface.y);
        surface.z = fmaf(weight, plane.z, surface.z);
        surface.w = fmaf(weight, plane.w, surface.w);
      }
      transmittance = after;
      last = at - first + k + 1;
    }
    __syncwarp();
  }
  if (!inside) return;
  const std::size_t p = static_cast<std::size_t>(y) * view.width + x;
  const math::Vec3 behind = rendered_background(view.background);
  w.image[p] = make_float4(fmaf(transmittance, behind.x, red), fmaf(transmittance, behind.y, green),
                           fmaf(transmittance, behind.z, blue), transmittance);
  w.last[p] = last;
  if (kPlanes) w.surface[p] = surface;
}

}  // namespace

void launch_blend(const View& view, const Workspace& w, cudaStream_t stream) {
  const dim3 tiles(view.tiles_x, view.tiles_y);
  const auto kernel = view.planes ? blend<true> : blend<false>;
  kernel<<<tiles, kWarps * 32, 0, stream>>>(view, w);
}

}  // namespace stgs::encoder::cuda
