// SPDX-License-Identifier: Apache-2.0
// Blending, nearest first. A warp draws 8 x 8 pixels, two a lane, by itself: a quarter of a tile,
// or at half resolution of a square of 2 x 2 tiles. It takes the list 32 splats at a time, a splat
// a lane, keeps those whose ellipse meets its quarter, and goes through these.
#include "cuda/footprint.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/fovea.h"

namespace stgs::player::cuda {
namespace {

using math::kTransmittanceMin;

constexpr int kWarps = 4;
constexpr int kSide = kQuarterPixels;      // pixels of a warp, width and height
constexpr int kEach = kSide * kSide / 32;  // pixels of a lane, below each other
constexpr int kStep = kSide / kEach;       // rows between them
// A little above log2(kAlphaMax): whatever ex2 rounds, two such splats end a pixel, as kAlphaMax's.
constexpr float kLog2AlphaMax = -0.014499f;

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
  float y;              // centre
  float transmittance;  // below 0 where the pixel is finished, or outside of the picture
  float red, green, blue, depth;
};

// Adds a splat of the weight alpha T where log2(alpha) >= kLog2Threshold, unless that would leave
// less than kTransmittanceMin: then the pixel is finished. Returns whether it was added. Without
// branches: most splats that are gone through are drawn at some pixel of the lanes.
__device__ bool add(Pixel& pixel, float log2_alpha, float weight, const float4& colour) {
  const float t = pixel.transmittance, after = t - weight;
  const bool met = log2_alpha >= kLog2Threshold, drawn = met && after >= kTransmittanceMin;
  const float added = drawn ? weight : 0.0f;
  pixel.red = fmaf(added, colour.x, pixel.red);
  pixel.green = fmaf(added, colour.y, pixel.green);
  pixel.blue = fmaf(added, colour.z, pixel.blue);
  pixel.depth = fmaf(added, colour.w, pixel.depth);
  pixel.transmittance = drawn ? after : met ? -fabsf(t) : t;
  return drawn;
}

// Returns to how many of the pixels it contributes.
__device__ unsigned blend_splat(const Quad& s, float px, Pixel (&pixels)[kEach]) {
  unsigned contributions = 0;
  const float dx = px - s.a.x;
  const float along = s.b.y + s.a.z * dx * dx, cross = s.a.w * dx;
#pragma unroll
  for (Pixel& pixel : pixels) {
    const float dy = pixel.y - s.a.y;
    const float log2_alpha = fminf(s.b.z, fmaf(dy, fmaf(s.b.x, dy, cross), along));
    const float weight = exp2_fast(log2_alpha) * pixel.transmittance;
    contributions += add(pixel, log2_alpha, weight, s.c) ? 1u : 0u;
  }
  return contributions;
}

// What a warp draws.
struct Patch {
  int tile;           // whose list it goes through
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
  out.halved = !has(sharp_squares(view, sy), sx);
  if (out.halved && of_square != 0) return false;
  const int tx = 2 * sx + of_square % 2, ty = 2 * sy + of_square / 2;
  if (tx >= view.tiles_x || ty >= view.tiles_y) return false;
  out.tile = ty * view.tiles_x + tx;
  out.width = out.halved ? (view.width + 1) / 2 : view.width;
  out.height = out.halved ? (view.height + 1) / 2 : view.height;
  out.x0 = (out.halved ? sx : tx) * kTilePixels + warp % 2 * kSide;
  out.y0 = (out.halved ? sy : ty) * kTilePixels + warp / 2 * kSide;
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
  const float t = fabsf(pixel.transmittance), alpha = 1.0f - t;
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

// Where there are foveae, some squares at half resolution have lists of thousands. Lists longer
// than this go first, in a layer of the grid of their own: begun late, one would keep the frame
// waiting.
constexpr std::uint32_t kLong = 1024;

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
  const int x = patch.x0 + lane % kSide, y = patch.y0 + lane / kSide;
  const float px = static_cast<float>(x) + 0.5f;
  Quad* const stage = stages[warp];
  Pixel pixels[kEach];
#pragma unroll
  for (int k = 0; k < kEach; ++k) {
    const bool inside = x < patch.width && y + k * kStep < patch.height;
    pixels[k] = {static_cast<float>(y + k * kStep) + 0.5f, inside ? 1.0f : -1.0f, 0, 0, 0, 0};
  }

  const uint2 range = ranges[view.first_tile + patch.tile];
  if (kFovea && (range.y - range.x > kLong) != (blockIdx.z == 0)) return;
  const unsigned quarter = 1u << (kSplatBits + warp);
  const auto listed = [&](std::uint32_t at) { return at < range.y ? list[at] : 0; };
  const auto load = [&](std::uint32_t number) {
    Quad s = load_quad(splats, number & (static_cast<std::uint32_t>(kMaxSplats) - 1));
    if (kFovea && patch.halved) s = halved(s);
    s.b.z = s.b.y > kLog2AlphaMax ? kLog2AlphaMax : s.b.y;  // the extents are not needed; NaN stays
    return s;
  };
  unsigned evaluations = 0, contributions = 0;  // of the lane, where they are counted
  // A splat is asked for one batch ahead, its number two.
  std::uint32_t number = listed(range.x + lane), next_number = listed(range.x + 32 + lane);
  Quad next{};
  if ((number & quarter) != 0) next = load(number);
  for (std::uint32_t at = range.x; at < range.y; at += 32) {
    bool finished = true;
#pragma unroll
    for (const Pixel& pixel : pixels) finished &= pixel.transmittance < 0.0f;
    if (__all_sync(kAllLanes, finished)) break;
    const bool met = (number & quarter) != 0;
    const unsigned hits = __ballot_sync(kAllLanes, met);
    if (met) stage[__popc(hits & ((1u << lane) - 1u))] = next;
    __syncwarp();
    number = next_number;
    if ((number & quarter) != 0) next = load(number);
    next_number = listed(at + 64 + lane);
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
  launch(kernel, dim3(grid.tiles, grid.views, grid.fovea ? 2 : 1), kWarps * 32, stream, input,
         static_cast<const uint2*>(w.tile_ranges),
         static_cast<const std::uint32_t*>(w.tile_splats[w.tile_passes % 2]),
         static_cast<const ScreenSplat*>(w.splats), w.counters);
}

}  // namespace stgs::player::cuda
