// SPDX-License-Identifier: Apache-2.0
// Blending, nearest first. A warp draws 8 x 8 pixels, two a lane, by itself: a quarter of a tile,
// or all of one at half resolution. It takes the tile's list 32 splats at a time, a splat a lane,
// keeps those whose ellipse meets its pixels, and goes through these.
#include "cuda/footprint.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/fovea.h"

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

// What a warp draws.
struct Patch {
  int tile;           // of the view
  int x0, y0;         // pixels, of the picture of half the size where it is halved
  int width, height;  // of that picture
  bool halved;
};

// A block of the grid is a tile. False where there is nothing for the warp.
__device__ bool find_patch(const ViewInput& view, int warp, Patch& out) {
  out.tile = static_cast<int>(blockIdx.x);
  out.width = view.width;
  out.height = view.height;
  out.x0 = out.tile % view.tiles_x * kTilePixels + warp % 2 * kSide;
  out.y0 = out.tile / view.tiles_x * kTilePixels + warp / 2 * kSide;
  out.halved = false;
  return out.x0 < out.width && out.y0 < out.height;
}

// The same where there are foveae: tiles come in the order of squares of 2 x 2, and of a square at
// half resolution the first block draws all.
__device__ bool find_patch_of_square(const ViewInput& view, int warp, Patch& out) {
  const int squares_x = (view.tiles_x + 1) / 2, square = static_cast<int>(blockIdx.x / 4);
  const int of_square = static_cast<int>(blockIdx.x % 4);
  const int sx = square % squares_x, sy = square / squares_x;
  constexpr float kSquare = math::kFoveaSquare;
  out.halved = math::beyond_fovea(view.fovea, view.fovea_radius, static_cast<float>(sx) * kSquare,
                                  static_cast<float>(sy) * kSquare);
  if (out.halved && of_square != 0) return false;
  const int number = out.halved ? warp : of_square;
  const int tx = 2 * sx + number % 2, ty = 2 * sy + number / 2;
  if (tx >= view.tiles_x || ty >= view.tiles_y) return false;
  out.tile = ty * view.tiles_x + tx;
  out.width = out.halved ? (view.width + 1) / 2 : view.width;
  out.height = out.halved ? (view.height + 1) / 2 : view.height;
  out.x0 = out.halved ? tx * kSide : tx * kTilePixels + warp % 2 * kSide;
  out.y0 = out.halved ? ty * kSide : ty * kTilePixels + warp / 2 * kSide;
  return out.x0 < out.width && out.y0 < out.height;
}

// The splat on the picture of half the size.
__device__ Quad halved(const Quad& s) {
  constexpr float kPerLog2 = -2.0f / 1.44269504f;
  const math::HalvedSplat shape =
      math::halved_splat({s.a.z * kPerLog2, 0.5f * s.a.w * kPerLog2, s.b.x * kPerLog2});
  constexpr float kLog2 = 1.0f / kPerLog2;
  Quad out = s;
  out.a = make_float4(0.5f * s.a.x, 0.5f * s.a.y, shape.conic.xx * kLog2,
                      2.0f * shape.conic.xy * kLog2);
  out.b.x = shape.conic.yy * kLog2;
  out.b.y = s.b.y + __log2f(shape.scale);
  return out;
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

// The square of 2 x 2 pixels from (x, y) on, as far as it lies in the picture.
__device__ void write_square(const Pixel& pixel, int x, int y, const ViewInput& view) {
  const bool right = x + 1 < view.width, below = y + 1 < view.height;
  write_pixel(pixel, x, y, view);
  if (right) write_pixel(pixel, x + 1, y, view);
  if (below) write_pixel(pixel, x, y + 1, view);
  if (right && below) write_pixel(pixel, x + 1, y + 1, view);
}

template <bool kCount, bool kFovea>
__global__ void __launch_bounds__(kWarps * 32)
    blend(const FrameInput* input, const uint2* ranges, const std::uint32_t* list,
          const ScreenSplat* splats, Counters* counters) {
  __shared__ Quad stages[kWarps][32];
  const int warp = static_cast<int>(threadIdx.x / 32), lane = static_cast<int>(threadIdx.x & 31);
  const ViewInput& view = input->views[blockIdx.y];
  Patch patch;
  // The whole warp; no barrier of the block follows.
  if (!(kFovea ? find_patch_of_square(view, warp, patch) : find_patch(view, warp, patch))) return;
  const auto load = [&](std::uint32_t number) {
    const Quad s = load_quad(splats, number);
    return kFovea && patch.halved ? halved(s) : s;
  };
  const int x = patch.x0 + lane % kSide, y = patch.y0 + lane / kSide;
  const float px = static_cast<float>(x) + 0.5f;
  const float left = static_cast<float>(patch.x0) + 0.5f, top = static_cast<float>(patch.y0) + 0.5f;
  const float right = static_cast<float>(min(patch.x0 + kSide, patch.width)) - 0.5f;
  const float bottom = static_cast<float>(min(patch.y0 + kSide, patch.height)) - 0.5f;
  Quad* const stage = stages[warp];
  Pixel pixels[kEach];
#pragma unroll
  for (int k = 0; k < kEach; ++k) {
    const bool inside = x < patch.width && y + k * kStep < patch.height;
    pixels[k] = {static_cast<float>(y + k * kStep) + 0.5f,
                 inside ? kLog2Threshold : kFinished,
                 1.0f,
                 0.0f,
                 0.0f,
                 0.0f,
                 0.0f};
  }

  const uint2 range = ranges[view.first_tile + patch.tile];
  unsigned evaluations = 0, contributions = 0;  // of the lane, where they are counted
  // A splat is asked for one batch ahead, its number two.
  Quad next{};
  std::uint32_t number = 0;
  if (range.x + lane < range.y) next = load(list[range.x + lane]);
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
    if (at + 32 + lane < range.y) next = load(number);
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
    const int row = y + k * kStep;
    if (x >= patch.width || row >= patch.height) continue;
    if (kFovea && patch.halved) {
      write_square(pixels[k], 2 * x, 2 * row, view);
    } else {
      write_pixel(pixels[k], x, row, view);
    }
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

void launch_blend(const FrameInput* input, const BlendGrid& grid, const Workspace& w, bool count,
                  cudaStream_t stream) {
  const auto kernel = grid.fovea ? (count ? blend<true, true> : blend<false, true>)
                                 : (count ? blend<true, false> : blend<false, false>);
  launch(kernel, dim3(grid.tiles, grid.views), kWarps * 32, stream, input,
         static_cast<const uint2*>(w.tile_ranges),
         static_cast<const std::uint32_t*>(w.tile_splats[w.tile_passes % 2]),
         static_cast<const ScreenSplat*>(w.splats), w.counters);
}

}  // namespace stgs::player::cuda
