// SPDX-License-Identifier: Apache-2.0
// Blends the splats of the views, nearest first. A warp renders 8 x 8 pixels independently, two per
// lane: a quarter of a tile, or at half resolution a quarter of a square of 2 x 2 tiles. It reads
// the list 32 splats at a time, one per lane, stages those whose ellipse meets its quarter, and
// blends them.
#include "cuda/footprint.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"
#include "stgs/format/math/colour.h"
#include "stgs/format/math/cuda.cuh"
#include "stgs/format/math/fovea.h"

namespace stgs::player::cuda {
namespace {

using math::exp2_fast;
using math::kLog2AlphaMax;
using math::kLog2Threshold;
using math::kTransmittanceMin;
using math::SplatVectors;

constexpr int kWarps = 4;
constexpr int kSide = kQuarterPixels;      // width and height of a warp's pixels
constexpr int kEach = kSide * kSide / 32;  // pixels per lane, in a column
constexpr int kStep = kSide / kEach;       // rows between them

// The input of the blend.
struct BlendLists {
  const uint2* ranges;        // per tile
  const std::uint32_t* list;  // of all tiles
  const ScreenSplat* splats;
  std::uint32_t* patches;  // kPatchClasses x patch_capacity, with foveae
  std::uint32_t patch_capacity;
};

struct Pixel {
  float y;              // centre
  float transmittance;  // negative: the pixel is finished or outside of the image
  float red, green, blue, depth;
};

// Adds a splat of weight alpha T, unless that leaves less than kTransmittanceMin: then the pixel is
// finished. Branch-free, since most staged splats contribute to some pixel of the lanes. For
// finished pixels, the weight is not positive and `after` is negative.
__device__ void add(Pixel& pixel, float weight, const float4& colour) {
  const float after = pixel.transmittance - weight, finished = -fabsf(pixel.transmittance);
  const bool contributes = after >= kTransmittanceMin;
  const float added = contributes ? weight : 0.0f;
  pixel.red = fmaf(added, colour.x, pixel.red);
  pixel.green = fmaf(added, colour.y, pixel.green);
  pixel.blue = fmaf(added, colour.z, pixel.blue);
  pixel.depth = fmaf(added, colour.w, pixel.depth);
  pixel.transmittance = contributes ? after : finished;
}

// Blends a splat. Returns the number of pixels to which it contributes.
__device__ unsigned blend_splat(const SplatVectors& s, float px, Pixel (&pixels)[kEach]) {
  unsigned contributions = 0;
  const float dx = px - s.a.x;
  const float along = s.b.y + s.a.z * dx * dx, cross = s.a.w * dx;
#pragma unroll
  for (Pixel& pixel : pixels) {
    const float dy = pixel.y - s.a.y;
    const float log2_alpha = fminf(s.b.z, fmaf(dy, fmaf(s.b.x, dy, cross), along));
    const float alpha = log2_alpha >= kLog2Threshold ? exp2_fast(log2_alpha) : 0.0f;
    const float before = pixel.transmittance;
    add(pixel, alpha * before, s.c);
    contributions += alpha > 0.0f && pixel.transmittance > 0.0f ? 1u : 0u;
  }
  return contributions;
}

// The pixels of a warp.
struct Patch {
  std::uint32_t tile;  // of the view, whose list is blended
  int x0, y0;          // pixels; at half resolution, of the image of half the size
  int width, height;   // of that image
};

// Returns a quarter of a tile, or, if `halved`, of the square of 2 x 2 tiles at half resolution
// whose first tile is `tile`. It may lie outside of the image.
__device__ Patch patch_of(const ViewInput& view, std::uint32_t tile, int quarter, bool halved) {
  Patch out;
  const int tx = static_cast<int>(tile) % view.tiles_x, ty = static_cast<int>(tile) / view.tiles_x;
  const int halvings = halved ? 1 : 0;
  out.tile = tile;
  out.width = (view.width + halvings) >> halvings;
  out.height = (view.height + halvings) >> halvings;
  out.x0 = (tx >> halvings) * kTilePixels + quarter % 2 * kSide;
  out.y0 = (ty >> halvings) * kTilePixels + quarter / 2 * kSide;
  return out;
}

// Converts a splat to the image of half the size.
__device__ SplatVectors halved(const SplatVectors& s) {
  const math::HalvedSplat shape = math::halved_splat(math::conic_of({s.a.z, s.a.w, s.b.x}));
  const math::Falloff falloff = math::falloff_of(shape.conic);
  SplatVectors out = s;
  out.a = make_float4(0.5f * s.a.x, 0.5f * s.a.y, falloff.xx, falloff.xy);
  out.b.x = falloff.yy;
  out.b.y = s.b.y + __log2f(shape.scale);
  return out;
}

__device__ void write_pixel(const Pixel& pixel, int x, int y, const ViewInput& view) {
  const std::size_t plane = static_cast<std::size_t>(view.width) * view.height;
  float* const to = view.planes + static_cast<std::size_t>(y) * view.width + x;
  const float t = fabsf(pixel.transmittance), alpha = 1.0f - t;
  const math::Vec3 colour = math::displayed(
      {fmaf(t, view.background.x, pixel.red), fmaf(t, view.background.y, pixel.green),
       fmaf(t, view.background.z, pixel.blue)},
      view.encoding);
  to[0] = colour.x;
  to[plane] = colour.y;
  to[2 * plane] = colour.z;
  to[3 * plane] = alpha;
  to[4 * plane] = alpha > 0.0f ? pixel.depth / alpha : 0.0f;
}

// Writes the square of 2 x 2 pixels from (x, y) on, clipped to the image.
__device__ void write_square(const Pixel& pixel, int x, int y, const ViewInput& view) {
  const bool right = x + 1 < view.width, below = y + 1 < view.height;
  write_pixel(pixel, x, y, view);
  if (right) write_pixel(pixel, x + 1, y, view);
  if (below) write_pixel(pixel, x, y + 1, view);
  if (right && below) write_pixel(pixel, x + 1, y + 1, view);
}

// Shared memory of a warp.
using Stage = SplatVectors[32];

// Counts of a lane, if enabled.
struct BlendCounts {
  unsigned evaluations = 0, contributions = 0;
};

// Blends the list of a patch. The whole warp calls it.
template <bool kCount, bool kHalved>
__device__ void blend_list(const uint2& range, unsigned quarter, const std::uint32_t* list,
                           const ScreenSplat* splats, float px, Pixel (&pixels)[kEach],
                           Stage& stage, BlendCounts& counts) {
  const int lane = static_cast<int>(threadIdx.x & 31);
  const unsigned quarter_bit = 1u << (kSplatBits + quarter);
  const auto listed = [&](std::uint32_t at) { return at < range.y ? list[at] : 0; };
  const auto load = [&](std::uint32_t number) {
    SplatVectors s =
        math::load_vectors(splats, number & (static_cast<std::uint32_t>(kMaxSplats) - 1));
    if (kHalved) s = halved(s);
    s.b.z = s.b.y > kLog2AlphaMax ? kLog2AlphaMax : s.b.y;  // replaces an unused extent; keeps NaN
    return s;
  };
  // Splats are loaded one batch ahead, list entries two.
  std::uint32_t number = listed(range.x + lane), next_number = listed(range.x + 32 + lane);
  SplatVectors next{};
  if ((number & quarter_bit) != 0) next = load(number);
  for (std::uint32_t at = range.x; at < range.y; at += 32) {
    bool finished = true;
#pragma unroll
    for (const Pixel& pixel : pixels) finished &= pixel.transmittance < 0.0f;
    if (__all_sync(kAllLanes, finished)) break;
    const bool met = (number & quarter_bit) != 0;
    const unsigned hits = __ballot_sync(kAllLanes, met);
    if (met) stage[__popc(hits & ((1u << lane) - 1u))] = next;
    __syncwarp();
    number = next_number;
    if ((number & quarter_bit) != 0) next = load(number);
    next_number = listed(at + 64 + lane);
    const int count = __popc(hits);
    for (int k = 0; k < count; ++k) {
      const unsigned contributed = blend_splat(stage[k], px, pixels);
      if (kCount) counts.contributions += contributed;
    }
    if (kCount) counts.evaluations += kEach * count;
    __syncwarp();
  }
}

// Blends a patch, which is a quarter of the tile or square, and writes its pixels. The whole warp
// calls it.
template <bool kCount, bool kHalved>
__device__ void blend_patch(const ViewInput& view, const Patch& patch, unsigned quarter,
                            const BlendLists& lists, Stage& stage, BlendCounts& counts) {
  if (patch.x0 >= patch.width || patch.y0 >= patch.height) return;
  const int lane = static_cast<int>(threadIdx.x & 31);
  const int x = patch.x0 + lane % kSide, y = patch.y0 + lane / kSide;
  Pixel pixels[kEach];
#pragma unroll
  for (int k = 0; k < kEach; ++k) {
    const bool inside = x < patch.width && y + k * kStep < patch.height;
    pixels[k] = {static_cast<float>(y + k * kStep) + 0.5f, inside ? 1.0f : -1.0f, 0, 0, 0, 0};
  }
  blend_list<kCount, kHalved>(lists.ranges[view.first_tile + patch.tile], quarter, lists.list,
                              lists.splats, static_cast<float>(x) + 0.5f, pixels, stage, counts);
#pragma unroll
  for (int k = 0; k < kEach; ++k) {
    const int row = y + k * kStep;
    if (x >= patch.width || row >= patch.height) continue;
    if (kHalved) {
      write_square(pixels[k], 2 * x, 2 * row, view);
    } else {
      write_pixel(pixels[k], x, row, view);
    }
  }
}

__device__ void add_counts(BlendCounts counts, Counters* counters) {
  counts.evaluations = warp_sum(counts.evaluations);
  counts.contributions = warp_sum(counts.contributions);
  if ((threadIdx.x & 31) != 0) return;
  atomicAdd(&counters->evaluations, counts.evaluations);
  atomicAdd(&counters->contributions, counts.contributions);
}

// One thread block per tile.
template <bool kCount>
__global__ void __launch_bounds__(kWarps * 32)
    blend(const FrameInput* input, const BlendLists lists, Counters* counters) {
  __shared__ Stage stages[kWarps];
  const unsigned warp = threadIdx.x / 32;
  const ViewInput& view = input->views[blockIdx.y];
  if (blockIdx.x >= static_cast<unsigned>(view.tiles_x * view.tiles_y)) return;
  BlendCounts counts;
  blend_patch<kCount, false>(view, patch_of(view, blockIdx.x, static_cast<int>(warp), false), warp,
                             lists, stages[warp], counts);
  if (kCount) add_counts(counts, counters);
}

// With foveae, tiles at full resolution and squares at half are rendered in classes of list length,
// longest first, since one that starts late prolongs the frame.
__device__ int class_of(std::uint32_t length) {
  return length > 4096 ? 0 : length > 1024 ? 1 : length > 256 ? 2 : kPatchClasses - 1;
}

// The code of a tile or square: the tile, the view above kTileBits, and a bit for squares.
constexpr std::uint32_t kTileBits = 28, kHalvedBit = std::uint32_t{1} << 31;
static_assert(kMaxFrameViews <= 1 << (31 - kTileBits));

// Adds a code to its class, if `is_valid`. The whole warp calls it.
__device__ void add_to_class(bool is_valid, std::uint32_t patch, std::uint32_t length,
                             const BlendLists& lists, Counters* counters) {
  const unsigned lane = threadIdx.x & 31;
  const int own = class_of(length);
  for (int k = 0; k < kPatchClasses; ++k) {
    const unsigned all = __ballot_sync(kAllLanes, is_valid && own == k);
    if (all == 0) continue;
    std::uint32_t first = 0;
    if (lane == 0)
      first = atomicAdd(&counters->patch_counts[k], static_cast<unsigned>(__popc(all)));
    first = __shfl_sync(kAllLanes, first, 0);
    if ((all >> lane & 1u) == 0) continue;
    lists.patches[k * lists.patch_capacity + first + __popc(all & ((1u << lane) - 1u))] = patch;
  }
}

// One thread per square of 2 x 2 tiles.
__global__ void __launch_bounds__(kWarps * 32)
    find_patches(const FrameInput* input, const BlendLists lists, Counters* counters) {
  const ViewInput& view = input->views[blockIdx.y];
  const int squares_x = (view.tiles_x + 1) / 2, squares_y = (view.tiles_y + 1) / 2;
  const int square = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  const int sx = square % squares_x, sy = square / squares_x;
  const bool inside = sy < squares_y;
  const bool is_halved = inside && !has(sharp_squares(view, sy), sx);
  for (int k = 0; k < 4; ++k) {
    const int tx = 2 * sx + k % 2, ty = 2 * sy + k / 2;
    const bool is_valid = inside && tx < view.tiles_x && ty < view.tiles_y && !(is_halved && k > 0);
    const auto tile = static_cast<std::uint32_t>(ty * view.tiles_x + tx);
    const uint2 range = is_valid ? lists.ranges[view.first_tile + tile] : make_uint2(0, 0);
    add_to_class(is_valid, tile | blockIdx.y << kTileBits | (is_halved ? kHalvedBit : 0u),
                 range.y - range.x, lists, counters);
  }
}

// One thread block per code; surplus blocks do nothing.
template <bool kCount>
__global__ void __launch_bounds__(kWarps * 32)
    blend_patches(const FrameInput* input, const BlendLists lists, Counters* counters) {
  __shared__ Stage stages[kWarps];
  const unsigned warp = threadIdx.x / 32;
  std::uint32_t index = blockIdx.x;
  int k = 0;
  while (k < kPatchClasses && index >= counters->patch_counts[k])
    index -= counters->patch_counts[k++];
  if (k == kPatchClasses) return;
  const std::uint32_t code = lists.patches[k * lists.patch_capacity + index];
  const std::uint32_t tile = code & ((1u << kTileBits) - 1u);
  const ViewInput& view = input->views[(code & ~kHalvedBit) >> kTileBits];
  const bool is_halved = (code & kHalvedBit) != 0;
  const Patch patch = patch_of(view, tile, static_cast<int>(warp), is_halved);
  BlendCounts counts;
  if (is_halved) {
    blend_patch<kCount, true>(view, patch, warp, lists, stages[warp], counts);
  } else {
    blend_patch<kCount, false>(view, patch, warp, lists, stages[warp], counts);
  }
  if (kCount) add_counts(counts, counters);
}

}  // namespace

void launch_blend(const FrameInput* input, const BlendGrid& grid, const Workspace& w, bool count,
                  cudaStream_t stream) {
  const BlendLists lists = {w.tile_ranges, w.tile_splats[w.tile_passes % 2], w.splats, w.patches,
                            w.patch_capacity};
  if (!grid.fovea) {
    launch(count ? blend<true> : blend<false>, dim3(grid.tiles, grid.views), kWarps * 32, stream,
           input, lists, w.counters);
    return;
  }
  constexpr unsigned kThreads = kWarps * 32;
  launch(find_patches, dim3((grid.squares + kThreads - 1) / kThreads, grid.views), kThreads, stream,
         input, lists, w.counters);
  launch(count ? blend_patches<true> : blend_patches<false>, grid.all_tiles, kThreads, stream,
         input, lists, w.counters);
}

}  // namespace stgs::player::cuda
