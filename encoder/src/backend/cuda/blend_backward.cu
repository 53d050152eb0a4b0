// SPDX-License-Identifier: Apache-2.0
// Backward blending, back to front. A block processes one segment of a tile's list, so that a long
// list is distributed over many blocks; it starts from the image that the forward pass stored in
// front of the next segment behind. For each batch of 32 splats:
// 1. Each warp processes the splats that intersect its pixels, sums a splat's gradients over its
//    lanes and stores them in shared memory.
// 2. The block sums over its warps, in order, and writes one entry per instance.
// There are no atomics: the order of summation is fixed, so a step is bit-reproducible.
//
// The sums over pixels, with g = dL/dpower, (dx, dy) the offset from the mean and w the blend
// weight: w dL/dcolour (3), w error, g, g dx, g dy, g dx^2, g dx dy, g dy^2, and the absolute
// values of the gradient of the mean (2). If L_n is on, also w dL/dsurface (4).
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

using math::kAlphaMax;

constexpr int kBatch = 32;  // splats

// Sums each of v's 12 entries over the warp's lanes and returns the sum of entry sum_index(L) to
// lane L (-1: none). Each exchange halves the number of entries per lane.
__device__ float sum_lanes(float (&v)[kSums], int lane) {
  const bool b4 = lane & 16, b3 = lane & 8, b2 = lane & 4, b1 = lane & 2;
#pragma unroll
  for (int q = 0; q < 6; ++q) {
    const float sent = b4 ? v[q] : v[q + 6];
    v[q] = (b4 ? v[q + 6] : v[q]) + __shfl_xor_sync(kAllLanes, sent, 16);
  }
#pragma unroll
  for (int q = 0; q < 3; ++q) {
    const float sent = b3 ? v[q] : v[q + 3];
    v[q] = (b3 ? v[q + 3] : v[q]) + __shfl_xor_sync(kAllLanes, sent, 8);
  }
  const float a = (b2 ? v[2] : v[0]) + __shfl_xor_sync(kAllLanes, b2 ? v[0] : v[2], 4);
  const float b = v[1] + __shfl_xor_sync(kAllLanes, v[1], 4);
  // Lanes with b2 have entry 2 in a; the others have 0 in a and 1 in b.
  const float retained = !b2 && b1 ? b : a;
  const float sent = !b2 && !b1 ? b : a;
  const float c = retained + __shfl_xor_sync(kAllLanes, sent, 2);
  return c + __shfl_xor_sync(kAllLanes, c, 1);
}

__device__ int sum_index(int lane) {
  const bool b2 = lane & 4, b1 = lane & 2;
  if ((lane & 1) || (b2 && b1)) return -1;
  return (lane & 16 ? 6 : 0) + (lane & 8 ? 3 : 0) + (b2 ? 2 : (b1 ? 1 : 0));
}

// The same for 4 entries; lane L returns entry plane_index(L).
__device__ float sum_plane_lanes(float4 v, int lane) {
  const bool b4 = lane & 16, b3 = lane & 8;
  const float a = (b4 ? v.z : v.x) + __shfl_xor_sync(kAllLanes, b4 ? v.x : v.z, 16);
  const float b = (b4 ? v.w : v.y) + __shfl_xor_sync(kAllLanes, b4 ? v.y : v.w, 16);
  float c = (b3 ? b : a) + __shfl_xor_sync(kAllLanes, b3 ? a : b, 8);
  for (int step = 4; step > 0; step >>= 1) c += __shfl_xor_sync(kAllLanes, c, step);
  return c;
}

__device__ int plane_index(int lane) {
  return lane % 8 == 0 ? lane / 8 : -1;
}

__device__ float dot4(float4 a, float4 b) {
  return fmaf(a.x, b.x, fmaf(a.y, b.y, fmaf(a.z, b.z, a.w * b.w)));
}

// State of a pixel, processed back to front.
struct Pixel {
  float y;
  float transmittance;  // in front of the processed splats
  float behind;         // dL/dcolour . (colour behind the splat)
  float red, green, blue, error;
  int last;
  float4 d_surface;  // used if L_n is on
};

// Loads a pixel for the list entries before `end`. `checkpoint`: index of the checkpoint at `end`.
template <bool kPlanes>
__device__ Pixel load_pixel(int x, int y, int end, std::size_t checkpoint, const View& view,
                            const Workspace& w) {
  Pixel p{};
  p.y = static_cast<float>(y) + 0.5f;
  if (x >= view.width || y >= view.height) return p;  // last = 0: does not contribute
  const std::size_t at = static_cast<std::size_t>(y) * view.width + x;
  const float4 d = w.d_image[at];
  p.red = d.x;
  p.green = d.y;
  p.blue = d.z;
  p.error = d.w;
  if (kPlanes) p.d_surface = w.d_surface[at];
  const float4 image = w.image[at];
  p.transmittance = image.w;
  p.last = static_cast<int>(w.last[at]);
  if (p.last <= end) {
    const math::Vec3 background = rendered_background(view.background);
    p.behind = d.x * background.x + d.y * background.y + d.z * background.z;
    return p;
  }
  checkpoint += (y & (kTile - 1)) * kTile + (x & (kTile - 1));
  const float4 front = w.checkpoints[checkpoint];
  p.last = end;
  p.transmittance = front.w;
  p.behind =
      (d.x * (image.x - front.x) + d.y * (image.y - front.y) + d.z * (image.z - front.z)) / front.w;
  if constexpr (kPlanes) {
    const float4 all = w.surface[at], in_front = w.surface_checkpoints[checkpoint];
    p.behind += dot4(p.d_surface, make_float4(all.x - in_front.x, all.y - in_front.y,
                                              all.z - in_front.z, all.w - in_front.w)) /
                front.w;
  }
  return p;
}

// Sums over a lane's pixels, which share dx, so the moments in x follow at the end.
struct ColumnSums {
  float red, green, blue, error, g, gy, gyy, abs_x, abs_y;
  float4 plane;
};

// A splat over a column of pixels.
struct Column {
  float dx, slope_x;  // 2 falloff.xx dx
  float cross_x;      // falloff.xy dx
  float base;         // peak + falloff.xx dx^2
};

// Accumulates splat k's gradients at the pixel and removes the splat from it. Returns whether the
// splat contributes there.
template <bool kPlanes>
__device__ bool add_pixel(const ScreenSplat& s, const float4& plane, const Column& c, int k,
                          Pixel& p, ColumnSums& v) {
  const float dy = p.y - s.mean.y;
  const float log2 = fminf(s.peak, fmaf(dy, fmaf(s.falloff.yy, dy, c.cross_x), c.base));
  if (k >= p.last || log2 < kLog2Threshold) return false;
  const float falloff = exp2_fast(log2);
  const float alpha = fminf(kAlphaMax, falloff);
  p.transmittance *= reciprocal_fast(1.0f - alpha);
  const float weight = alpha * p.transmittance;
  float own = fmaf(p.red, s.colour.x, fmaf(p.green, s.colour.y, p.blue * s.colour.z));
  if constexpr (kPlanes) {
    own += dot4(p.d_surface, plane);
    v.plane.x = fmaf(weight, p.d_surface.x, v.plane.x);
    v.plane.y = fmaf(weight, p.d_surface.y, v.plane.y);
    v.plane.z = fmaf(weight, p.d_surface.z, v.plane.z);
    v.plane.w = fmaf(weight, p.d_surface.w, v.plane.w);
  }
  const float gain = own - p.behind;
  p.behind = fmaf(alpha, gain, p.behind);
  v.red = fmaf(weight, p.red, v.red);
  v.green = fmaf(weight, p.green, v.green);
  v.blue = fmaf(weight, p.blue, v.blue);
  v.error = fmaf(weight, p.error, v.error);
  // dL/dpower = -alpha dL/dalpha; 0 if alpha is clamped at its maximum.
  const float g = falloff <= kAlphaMax ? -weight * gain : 0.0f;
  const float gy = g * dy;
  v.g += g;
  v.gy += gy;
  v.gyy = fmaf(gy, dy, v.gyy);
  // The gradient of the mean in units of 1/log2(e), which the update removes.
  v.abs_x = fmaf(fabsf(g), fabsf(fmaf(s.falloff.xy, dy, c.slope_x)), v.abs_x);
  v.abs_y = fmaf(fabsf(g), fabsf(fmaf(2.0f * s.falloff.yy, dy, c.cross_x)), v.abs_y);
  return true;
}

// Shared memory of a block.
template <int kWarps, bool kPlanes>
struct Shared {
  float4 stage[kBatch * 3];  // the splats of the batch
  float sums[kWarps][kBatch * kSums];
  float4 plane_stage[kPlanes ? kBatch : 1];
  float plane_sums[kPlanes ? kWarps : 1][kPlanes ? kBatch * kPlaneSums : 1];
  unsigned touched[kWarps];  // per warp, one bit per splat that contributes
  std::uint32_t instances[kBatch];
  int warp_last[kWarps];
};

// The segment of a block, and the pixels of a warp: pixel centres from (left, top) to (right,
// bottom).
struct Segment {
  std::uint32_t first;     // entry of the tile's list
  int begin, end;          // of the segment, counted from `first`
  std::size_t checkpoint;  // at `end`
  int x0, y0;
  float left, top, right, bottom;
};

template <int kPer>
__device__ Segment segment_of(uint2 number, int warp, const View& view, const Workspace& w) {
  constexpr int kRows = 4 * kPer;
  Segment s;
  s.x0 = static_cast<int>(number.x) % view.tiles_x * kTile + warp % 2 * 8;
  s.y0 = static_cast<int>(number.x) / view.tiles_x * kTile + warp / 2 * kRows;
  s.left = static_cast<float>(s.x0) + 0.5f;
  s.top = static_cast<float>(s.y0) + 0.5f;
  s.right = static_cast<float>(min(s.x0 + 8, view.width)) - 0.5f;
  s.bottom = static_cast<float>(min(s.y0 + kRows, view.height)) - 0.5f;
  s.first = w.tile_begin[number.x];
  const int count = static_cast<int>(w.tile_begin[number.x + 1] - s.first);
  s.begin = static_cast<int>(number.y) * kSegment;
  s.end = min(s.begin + kSegment, count);
  s.checkpoint = std::size_t{kTile * kTile} * (blockIdx.x + 1);
  return s;
}

// Clears the sums of the entries from `last` on: those behind the last rendered one have no
// gradient.
template <int kThreads, bool kPlanes>
__device__ void clear_sums(const Segment& s, int last, const Workspace& w) {
  for (int q = last * kSums + static_cast<int>(threadIdx.x); q < s.end * kSums; q += kThreads)
    w.partials[static_cast<std::size_t>(w.instances_sorted[s.first + q / kSums]) * kSums +
               q % kSums] = 0.0f;
  if constexpr (kPlanes) {
    for (int q = last + static_cast<int>(threadIdx.x); q < s.end; q += kThreads)
      w.plane_partials[w.instances_sorted[s.first + q]] = float4{};
  }
}

// Loads the n splats of a batch; `first`: its first entry.
template <int kWarps, bool kPlanes>
__device__ void load_batch(Shared<kWarps, kPlanes>& shared, std::uint32_t first, int n,
                           const Workspace& w) {
  if (threadIdx.x < 3 * n)
    shared.stage[threadIdx.x] = reinterpret_cast<const float4*>(
        w.splats + w.list[first + threadIdx.x / 3])[threadIdx.x % 3];
  if (threadIdx.x < n) shared.instances[threadIdx.x] = w.instances_sorted[first + threadIdx.x];
  if constexpr (kPlanes) {
    if (threadIdx.x < n) shared.plane_stage[threadIdx.x] = w.planes[w.list[first + threadIdx.x]];
  }
}

// Adds the gradients of splat k of the batch at the lane's pixels; `entry`: in the tile's list.
// Writes the sums over the warp, each by the lane whose `own_sum` it is. Returns whether the splat
// contributes to the warp's pixels. The whole warp calls it.
template <int kPer, int kWarps, bool kPlanes>
__device__ bool add_splat(Shared<kWarps, kPlanes>& shared, int k, int entry, float x,
                          Pixel (&pixels)[kPer], float* own_sum) {
  const int warp = threadIdx.x / 32, lane = threadIdx.x & 31;
  const ScreenSplat& s = reinterpret_cast<const ScreenSplat*>(shared.stage)[k];
  const float dx = x - s.mean.x, half_x = s.falloff.xx * dx;
  const Column column{dx, 2.0f * half_x, s.falloff.xy * dx, fmaf(half_x, dx, s.peak)};
  ColumnSums c{};
  bool any = false;
#pragma unroll
  for (int q = 0; q < kPer; ++q)
    any |= add_pixel<kPlanes>(s, shared.plane_stage[kPlanes ? k : 0], column, entry, pixels[q], c);
  if (!__any_sync(kAllLanes, any)) return false;
  const float gx = c.g * dx;
  float v[kSums] = {c.red, c.green, c.blue,    c.error, c.g,     gx,
                    c.gy,  gx * dx, c.gy * dx, c.gyy,   c.abs_x, c.abs_y};
  const float sum = sum_lanes(v, lane);
  if (sum_index(lane) >= 0) own_sum[k * kSums] = sum;
  if constexpr (kPlanes) {
    const float plane_sum = sum_plane_lanes(c.plane, lane);
    const int entry_of_lane = plane_index(lane);
    if (entry_of_lane >= 0) shared.plane_sums[warp][k * kPlaneSums + entry_of_lane] = plane_sum;
  }
  return true;
}

// Writes the sums of the n splats of a batch over the warps, in their order.
template <int kWarps, bool kPlanes>
__device__ void write_batch(const Shared<kWarps, kPlanes>& shared, int n, const Workspace& w) {
  constexpr int kThreads = 32 * kWarps;
  for (int q = static_cast<int>(threadIdx.x); q < n * kSums; q += kThreads) {
    float sum = 0.0f;
#pragma unroll
    for (int v = 0; v < kWarps; ++v)
      if (shared.touched[v] >> (q / kSums) & 1u) sum += shared.sums[v][q];
    w.partials[static_cast<std::size_t>(shared.instances[q / kSums]) * kSums + q % kSums] = sum;
  }
  if constexpr (kPlanes) {
    for (int q = static_cast<int>(threadIdx.x); q < n * kPlaneSums; q += kThreads) {
      float sum = 0.0f;
#pragma unroll
      for (int v = 0; v < kWarps; ++v)
        if (shared.touched[v] >> (q / kPlaneSums) & 1u) sum += shared.plane_sums[v][q];
      reinterpret_cast<float*>(w.plane_partials +
                               shared.instances[q / kPlaneSums])[q % kPlaneSums] = sum;
    }
  }
}

// Each lane has kPer pixels, each warp 8 x 4 kPer.
template <int kPer, bool kPlanes>
__global__ void __launch_bounds__(256 / kPer) blend_backward(const View view, const Workspace w) {
  constexpr int kWarps = 8 / kPer, kThreads = 32 * kWarps;
  __shared__ Shared<kWarps, kPlanes> shared;
  const int tiles = view.tiles_x * view.tiles_y;
  if (blockIdx.x >= first_segment(w.tile_begin[tiles], tiles)) return;
  const uint2 number = w.segments[blockIdx.x];
  if (number.x >= tiles) return;
  const int warp = threadIdx.x / 32, lane = threadIdx.x & 31;
  const Segment segment = segment_of<kPer>(number, warp, view, w);
  const float x = segment.left + static_cast<float>(lane % 8);
  Pixel pixels[kPer];
  int own_last = 0;
#pragma unroll
  for (int q = 0; q < kPer; ++q) {
    pixels[q] = load_pixel<kPlanes>(segment.x0 + lane % 8, segment.y0 + lane / 8 + 4 * q,
                                    segment.end, segment.checkpoint, view, w);
    own_last = max(own_last, pixels[q].last);
  }
  own_last = __reduce_max_sync(kAllLanes, own_last);
  if (lane == 0) shared.warp_last[warp] = own_last;
  __syncthreads();
  const int begin = segment.begin;
  int block_last = begin;
#pragma unroll
  for (int q = 0; q < kWarps; ++q) block_last = max(block_last, shared.warp_last[q]);
  clear_sums<kThreads, kPlanes>(segment, block_last, w);

  float* own_sum = shared.sums[warp] + sum_index(lane);
  asm("" : "+l"(own_sum));  // keeps it in a register instead of recomputing it per splat
  for (int base = begin + (block_last - begin - 1) / kBatch * kBatch;
       base >= begin && block_last > begin; base -= kBatch) {
    const int n = min(kBatch, block_last - base);
    load_batch(shared, segment.first + base, n, w);
    __syncthreads();
    const ScreenSplat* splats = reinterpret_cast<const ScreenSplat*>(shared.stage);
    const bool hit =
        lane < n && base + lane < own_last &&
        ellipse_meets(splats[lane], segment.left, segment.right, segment.top, segment.bottom);
    unsigned hits = __ballot_sync(kAllLanes, hit), contributing = 0;
    while (hits != 0) {
      const int k = 31 - __clz(hits);
      hits ^= 1u << k;
      if (add_splat<kPer>(shared, k, base + k, x, pixels, own_sum)) contributing |= 1u << k;
    }
    if (lane == 0) shared.touched[warp] = contributing;
    __syncthreads();
    write_batch(shared, n, w);
    __syncthreads();
  }
}

}  // namespace

void launch_blend_backward(const View& view, std::size_t bound, const Workspace& w,
                           cudaStream_t stream) {
  constexpr int kPer = 2;
  const std::size_t tiles = std::size_t{1} * view.tiles_x * view.tiles_y;
  const auto segments = static_cast<unsigned>(segment_count(bound, tiles));
  const auto kernel = view.planes ? blend_backward<kPer, true> : blend_backward<kPer, false>;
  kernel<<<segments, 256 / kPer, 0, stream>>>(view, w);
}

}  // namespace stgs::encoder::cuda
