// SPDX-License-Identifier: Apache-2.0
// Blending, nearest first. A warp draws a quarter of a tile, 8 x 8 pixels, two a lane, by itself:
// it takes the tile's list 32 splats at a time, a splat a lane, keeps those whose ellipse meets its
// pixels, and goes through these.
#include "cuda/footprint.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"
#include "stgs/format/math/blend.h"

namespace stgs::player::cuda {
namespace {

using math::kAlphaMax;
using math::kTransmittanceMin;

constexpr int kWarps = 4;
constexpr int kSide = 8;                   // pixels of a warp, width and height
constexpr int kEach = kSide * kSide / 32;  // pixels of a lane, below each other
constexpr int kStep = kSide / kEach;       // rows between them
constexpr float kFinished = 1e30f;         // a threshold that no alpha reaches

__device__ float exp2_fast(float x) {
#ifdef __CUDA_ARCH__
  float y;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
#else
  return exp2f(x);
#endif
}

struct Pixel {
  float y;          // centre
  float threshold;  // log2 of the least alpha that is drawn, or kFinished
  float transmittance, red, green, blue, depth;
};

// Returns to how many of the pixels it contributes.
__device__ unsigned blend_splat(const Quad& s, float px, Pixel (&pixels)[kEach]) {
  unsigned contributions = 0;
  const float dx = px - s.a.x;
  const float along = s.b.y + s.a.z * dx * dx, cross = s.a.w * dx;
#pragma unroll
  for (Pixel& pixel : pixels) {
    const float dy = pixel.y - s.a.y;
    const float log2 = fminf(s.b.y, fmaf(dy, fmaf(s.b.x, dy, cross), along));
    // Without branches: most splats that are gone through are drawn at some pixel of the lanes.
    const float alpha = fminf(kAlphaMax, exp2_fast(log2));
    const float after = pixel.transmittance * (1.0f - alpha);
    const bool met = log2 >= pixel.threshold, ends = met && after < kTransmittanceMin;
    const bool drawn = met && !ends;
    const float weight = drawn ? alpha * pixel.transmittance : 0.0f;
    pixel.red = fmaf(weight, s.c.x, pixel.red);
    pixel.green = fmaf(weight, s.c.y, pixel.green);
    pixel.blue = fmaf(weight, s.c.z, pixel.blue);
    pixel.depth = fmaf(weight, s.c.w, pixel.depth);
    pixel.transmittance = drawn ? after : pixel.transmittance;
    pixel.threshold = ends ? kFinished : pixel.threshold;
    contributions += drawn;
  }
  return contributions;
}

__device__ void write_pixel(const Pixel& pixel, int x, int y, const ViewInput& view) {
  const std::size_t plane = static_cast<std::size_t>(view.width) * view.height;
  float* const to = view.planes + static_cast<std::size_t>(y) * view.width + x;
  const float t = pixel.transmittance, alpha = 1.0f - t;
  to[0] = fmaf(t, view.background.x, pixel.red);
  to[plane] = fmaf(t, view.background.y, pixel.green);
  to[2 * plane] = fmaf(t, view.background.z, pixel.blue);
  to[3 * plane] = alpha;
  to[4 * plane] = alpha > 0.0f ? pixel.depth / alpha : 0.0f;
}

// A block draws the tile blockIdx.x of the view blockIdx.y, where there is one.
template <bool kCount>
__global__ void __launch_bounds__(kWarps * 32)
    blend(const FrameInput* input, const uint2* ranges, const std::uint32_t* list,
          const ScreenSplat* splats, Counters* counters) {
  __shared__ Quad stages[kWarps][32];
  const int warp = static_cast<int>(threadIdx.x / 32), lane = static_cast<int>(threadIdx.x & 31);
  const ViewInput& view = input->views[blockIdx.y];
  const int width = view.width, height = view.height, tiles_x = view.tiles_x;
  const int tile = static_cast<int>(blockIdx.x);
  const int x0 = tile % tiles_x * kTilePixels + warp % 2 * kSide;
  const int y0 = tile / tiles_x * kTilePixels + warp / 2 * kSide;
  if (x0 >= width || y0 >= height) return;  // the whole warp; no barrier of the block follows
  const int x = x0 + lane % kSide, y = y0 + lane / kSide;
  const float px = static_cast<float>(x) + 0.5f;
  const float left = static_cast<float>(x0) + 0.5f, top = static_cast<float>(y0) + 0.5f;
  const float right = static_cast<float>(min(x0 + kSide, width)) - 0.5f;
  const float bottom = static_cast<float>(min(y0 + kSide, height)) - 0.5f;
  Quad* const stage = stages[warp];
  Pixel pixels[kEach];
#pragma unroll
  for (int k = 0; k < kEach; ++k) {
    const bool inside = x < width && y + k * kStep < height;
    pixels[k] = {static_cast<float>(y + k * kStep) + 0.5f,
                 inside ? kLog2Threshold : kFinished,
                 1.0f,
                 0.0f,
                 0.0f,
                 0.0f,
                 0.0f};
  }

  const uint2 range = ranges[view.first_tile + blockIdx.x];
  unsigned evaluations = 0, contributions = 0;  // of the lane, where they are counted
  // A splat is asked for one batch ahead, its number two.
  Quad next{};
  std::uint32_t number = 0;
  if (range.x + lane < range.y) next = load_quad(splats, list[range.x + lane]);
  if (range.x + 32 + lane < range.y) number = list[range.x + 32 + lane];
  for (std::uint32_t at = range.x; at < range.y; at += 32) {
    bool finished = true;
#pragma unroll
    for (const Pixel& pixel : pixels) finished &= pixel.threshold == kFinished;
    if (__all_sync(kAllLanes, finished)) break;
    const bool met = at + lane < range.y && meets(next, left, right, top, bottom);
    const unsigned hits = __ballot_sync(kAllLanes, met);
    if (met) stage[__popc(hits & ((1u << lane) - 1u))] = next;
    __syncwarp();
    if (at + 32 + lane < range.y) next = load_quad(splats, number);
    if (at + 64 + lane < range.y) number = list[at + 64 + lane];
    const int count = __popc(hits);
    for (int k = 0; k < count; ++k) {
      const unsigned contributed = blend_splat(stage[k], px, pixels);
      if (kCount) contributions += contributed;
    }
    if (kCount) evaluations += kEach * count;
    __syncwarp();
  }
#pragma unroll
  for (int k = 0; k < kEach; ++k) {
    if (x < width && y + k * kStep < height) write_pixel(pixels[k], x, y + k * kStep, view);
  }
  if (kCount) {
    evaluations = warp_sum(evaluations);
    contributions = warp_sum(contributions);
    if (lane == 0) {
      atomicAdd(&counters->evaluations, evaluations);
      atomicAdd(&counters->contributions, contributions);
    }
  }
}

}  // namespace

void launch_blend(const FrameInput* input, unsigned tiles, unsigned views, const Workspace& w,
                  bool count, cudaStream_t stream) {
  launch(count ? blend<true> : blend<false>, dim3(tiles, views), kWarps * 32, stream, input,
         static_cast<const uint2*>(w.tile_ranges),
         static_cast<const std::uint32_t*>(w.tile_splats[w.tile_passes % 2]),
         static_cast<const ScreenSplat*>(w.splats), w.counters);
}

}  // namespace stgs::player::cuda
