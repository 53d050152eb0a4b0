// SPDX-License-Identifier: Apache-2.0
// The loss of train/image_loss.h, evaluated through the camera's colour map: L1 and SSIM with an 11
// x 11 zero-padded Gaussian window, channel by channel, rows then columns in shared memory. A
// thread computes adjacent pixels, which share most of what it loads. The first kernel computes the
// derivatives of SSIM with respect to the window means, the second blurs them into dL/dcolour. Each
// block writes its sums; the last kernel of the step adds them in order.
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

constexpr int kRadius = 5, kTaps = 2 * kRadius + 1;
constexpr int kAreaX = kLossX + 2 * kRadius + 2, kAreaY = kLossY + 2 * kRadius;
constexpr int kArea = kAreaX * kAreaY;
constexpr int kThreads = 256;
constexpr int kOwn = kLossX * kLossY / kThreads;  // pixels per thread, one below the other
constexpr int kGroup = 4;                         // pixels per thread in the pass over rows
constexpr int kGroups = kAreaY * kLossX / kGroup;
static_assert(kLossX == 32 && kAreaX % kGroup == 0);
constexpr float kC1 = 0.01f * 0.01f, kC2 = 0.03f * 0.03f;

// exp(-d^2 / (2 1.5^2)), normalised, for distances 0 to 5; checked by the parity test.
__device__ constexpr float kWindow[kRadius + 1] = {0.266011725f,  0.213005538f,   0.109360690f,
                                                   0.0360007721f, 0.00759875814f, 0.00102838008f};

__device__ constexpr float tap(int k) {
  return kWindow[k < kRadius ? kRadius - k : k - kRadius];
}

struct ImagePair {
  const float4* rendered;
  const std::uint8_t* ground_truth;
  const float* map;  // 12
  int width, height;
  Background background;
};

// Returns a channel of the corrected colour.
__device__ float corrected(const float4& colour, const float* map, int c) {
  return map[3 * c] * colour.x + map[3 * c + 1] * colour.y + map[3 * c + 2] * colour.z + map[9 + c];
}

__device__ float ground_truth_value(const ImagePair& p, std::size_t at, int c) {
  return static_cast<float>(p.ground_truth[3 * at + c]) * (1.0f / 255.0f);
}

// A pixel of the thread.
struct OwnPixel {
  int x, y;
  bool inside;
  std::size_t at;
};

__device__ OwnPixel own_pixel(int own, int width, int height) {
  OwnPixel p;
  p.x = static_cast<int>(blockIdx.x) * kLossX + static_cast<int>(threadIdx.x) % kLossX;
  p.y = static_cast<int>(blockIdx.y) * kLossY + static_cast<int>(threadIdx.x) / kLossX * kOwn + own;
  p.inside = p.x < width && p.y < height;
  p.at = static_cast<std::size_t>(p.y) * width + p.x;
  return p;
}

// The values under the windows of a group of adjacent pixels of a row.
struct GroupValues {
  float v[4 * kGroup];
  __device__ explicit GroupValues(const float* from) {
#pragma unroll
    for (int k = 0; k < 4; ++k) {
      const float4 four = reinterpret_cast<const float4*>(from)[k];
      v[4 * k] = four.x;
      v[4 * k + 1] = four.y;
      v[4 * k + 2] = four.z;
      v[4 * k + 3] = four.w;
    }
  }
};
static_assert(4 * kGroup >= kGroup + kTaps - 1);

// Adds the weighted value e of a row or column to the sums of the adjacent pixels in whose window
// it is.
template <int kPixels>
__device__ void add_tap(float value, int e, float (&sums)[kPixels]) {
#pragma unroll
  for (int o = 0; o < kPixels; ++o) {
    if (e >= o && e < o + kTaps) sums[o] = fmaf(tap(e - o), value, sums[o]);
  }
}

__device__ void store_group(float* to, const float (&sums)[kGroup]) {
  *reinterpret_cast<float4*>(to) = make_float4(sums[0], sums[1], sums[2], sums[3]);
}

// Loads the block's area of both images, 0 beyond the border.
__device__ void load_area(const ImagePair& p, float (*x)[kArea], float (*y)[kArea]) {
  const int x0 = static_cast<int>(blockIdx.x) * kLossX - kRadius;
  const int y0 = static_cast<int>(blockIdx.y) * kLossY - kRadius;
  float map[12];
#pragma unroll
  for (int k = 0; k < 12; ++k) map[k] = p.map[k];
  for (int q = static_cast<int>(threadIdx.x); q < kArea; q += kThreads) {
    const int px = x0 + q % kAreaX, py = y0 + q / kAreaX;
    const bool inside = px >= 0 && py >= 0 && px < p.width && py < p.height;
    const std::size_t at = inside ? static_cast<std::size_t>(py) * p.width + px : 0;
    const float4 colour = inside ? p.rendered[at] : float4{};
#pragma unroll
    for (int c = 0; c < 3; ++c) {
      x[c][q] = inside ? corrected(colour, map, c) : 0.0f;
      y[c][q] = inside ? ground_truth_value(p, at, c) : 0.0f;
    }
  }
}

// Window means of x, y, xx, yy, xy.
struct Means {
  float x, y, xx, yy, xy;
};
constexpr int kMeans = 5;
using MeanRows = float[kMeans][kAreaY * kLossX];

// The means over the rows of the windows of a group.
__device__ void row_means(const float* x, const float* y, int group, MeanRows& rows) {
  const int row = group / (kLossX / kGroup), column = group % (kLossX / kGroup) * kGroup;
  const GroupValues a(x + row * kAreaX + column), b(y + row * kAreaX + column);
  float sums[kMeans][kGroup] = {};
#pragma unroll
  for (int e = 0; e < kGroup + kTaps - 1; ++e) {
    add_tap(a.v[e], e, sums[0]);
    add_tap(b.v[e], e, sums[1]);
    add_tap(a.v[e] * a.v[e], e, sums[2]);
    add_tap(b.v[e] * b.v[e], e, sums[3]);
    add_tap(a.v[e] * b.v[e], e, sums[4]);
  }
#pragma unroll
  for (int m = 0; m < kMeans; ++m) store_group(rows[m] + row * kLossX + column, sums[m]);
}

// Sums a column of row sums under the windows of the thread's pixels.
__device__ void column_sums(const float* rows, float (&sums)[kOwn]) {
  const float* from = rows + static_cast<int>(threadIdx.x) / kLossX * kOwn * kLossX +
                      static_cast<int>(threadIdx.x) % kLossX;
#pragma unroll
  for (int o = 0; o < kOwn; ++o) sums[o] = 0.0f;
#pragma unroll
  for (int e = 0; e < kOwn + kTaps - 1; ++e) add_tap(from[e * kLossX], e, sums);
}

struct Slopes {
  float by_x, by_xx, by_xy;
};

// Returns the SSIM of a window; computes its derivatives with respect to the means of x, x^2 and
// xy.
__device__ float ssim_of(const Means& m, Slopes& slopes) {
  const float x_y = m.x * m.y, squares = m.x * m.x + m.y * m.y;
  const float a1 = 2.0f * x_y + kC1, a2 = 2.0f * (m.xy - x_y) + kC2;
  const float b1 = squares + kC1, b2 = m.xx + m.yy - squares + kC2;
  const float inverse = 1.0f / (b1 * b2);
  const float s = a1 * a2 * inverse;
  // S = a1 a2 / (b1 b2); the variances hold -x^2 and -xy.
  const float by_a1 = a2 * inverse, by_a2 = a1 * inverse;
  const float by_b1 = -s * inverse * b2, by_b2 = -s * inverse * b1;
  slopes.by_x = 2.0f * (m.y * (by_a1 - by_a2) + m.x * (by_b1 - by_b2));
  slopes.by_xx = by_b2;
  slopes.by_xy = 2.0f * by_a2;
  return s;
}

__global__ void __launch_bounds__(kThreads)
    ssim_forward(const ImagePair p, float* slopes, float* error, float* sums) {
  __shared__ __align__(16) float x[3][kArea], y[3][kArea];
  __shared__ __align__(16) MeanRows rows;
  load_area(p, x, y);
  const std::size_t pixels = static_cast<std::size_t>(p.width) * p.height;
  float ssim[kOwn] = {};
  for (int c = 0; c < 3; ++c) {
    __syncthreads();
    if (threadIdx.x < kGroups) row_means(x[c], y[c], static_cast<int>(threadIdx.x), rows);
    __syncthreads();
    float means[kMeans][kOwn];
#pragma unroll
    for (int m = 0; m < kMeans; ++m) column_sums(rows[m], means[m]);
#pragma unroll
    for (int own = 0; own < kOwn; ++own) {
      const OwnPixel pixel = own_pixel(own, p.width, p.height);
      if (!pixel.inside) continue;
      Slopes by;
      ssim[own] +=
          ssim_of({means[0][own], means[1][own], means[2][own], means[3][own], means[4][own]}, by);
      slopes[(3 * c) * pixels + pixel.at] = by.by_x;
      slopes[(3 * c + 1) * pixels + pixel.at] = by.by_xx;
      slopes[(3 * c + 2) * pixels + pixel.at] = by.by_xy;
    }
  }
  float sum = 0.0f;
#pragma unroll
  for (int own = 0; own < kOwn; ++own) {
    const OwnPixel pixel = own_pixel(own, p.width, p.height);
    sum += ssim[own];
    if (pixel.inside) error[pixel.at] = fminf(fmaxf(1.0f - ssim[own] * (1.0f / 3.0f), 0.0f), 1.0f);
  }
  sum = block_sum<kThreads>(sum);
  if (threadIdx.x == 0) sums[blockIdx.y * gridDim.x + blockIdx.x] = sum;
}

// Loads the block's area of the slopes of channel c, 0 beyond the border.
__device__ void load_slopes(const ImagePair& p, const float* slopes, int c, float (*area)[kArea]) {
  const std::size_t pixels = static_cast<std::size_t>(p.width) * p.height;
  const int x0 = static_cast<int>(blockIdx.x) * kLossX - kRadius;
  const int y0 = static_cast<int>(blockIdx.y) * kLossY - kRadius;
  for (int q = static_cast<int>(threadIdx.x); q < kArea; q += kThreads) {
    const int px = x0 + q % kAreaX, py = y0 + q / kAreaX;
    const bool inside = px >= 0 && py >= 0 && px < p.width && py < p.height;
    const std::size_t at = inside ? static_cast<std::size_t>(py) * p.width + px : 0;
#pragma unroll
    for (int m = 0; m < 3; ++m) area[m][q] = inside ? slopes[(3 * c + m) * pixels + at] : 0.0f;
  }
}

__device__ void blur_rows(const float* area, int group, float* rows) {
  const int row = group / (kLossX / kGroup), column = group % (kLossX / kGroup) * kGroup;
  const GroupValues values(area + row * kAreaX + column);
  float sums[kGroup] = {};
#pragma unroll
  for (int e = 0; e < kGroup + kTaps - 1; ++e) add_tap(values.v[e], e, sums);
  store_group(rows + row * kLossX + column, sums);
}

// Writes dL/dcolour of the thread's pixels, whose gradients after the colour map are d, and adds
// the gradients of the map.
__device__ void write_gradient(const ImagePair& p, const float (&map)[12],
                               const float (&d)[kOwn][3], const float* error, float4* d_image,
                               float (&by_map)[12]) {
#pragma unroll
  for (int own = 0; own < kOwn; ++own) {
    const OwnPixel pixel = own_pixel(own, p.width, p.height);
    if (!pixel.inside) continue;
    const float4 colour = mapped_part(p.background, p.rendered[pixel.at]);
    const float(&g)[3] = d[own];
    d_image[pixel.at] = make_float4(map[0] * g[0] + map[3] * g[1] + map[6] * g[2],
                                    map[1] * g[0] + map[4] * g[1] + map[7] * g[2],
                                    map[2] * g[0] + map[5] * g[1] + map[8] * g[2], error[pixel.at]);
#pragma unroll
    for (int c = 0; c < 3; ++c) {
      by_map[3 * c] = fmaf(g[c], colour.x, by_map[3 * c]);
      by_map[3 * c + 1] = fmaf(g[c], colour.y, by_map[3 * c + 1]);
      by_map[3 * c + 2] = fmaf(g[c], colour.z, by_map[3 * c + 2]);
      by_map[9 + c] = fmaf(g[c], colour.w, by_map[9 + c]);
    }
  }
}

__global__ void __launch_bounds__(kThreads)
    loss_gradient(const ImagePair p, const float* slopes, const float* error, float l1_scale,
                  float ssim_scale, float4* d_image, float* sums) {
  __shared__ __align__(16) float area[3][kArea];
  __shared__ __align__(16) float rows[3][kAreaY * kLossX];
  float map[12];
#pragma unroll
  for (int k = 0; k < 12; ++k) map[k] = p.map[k];
  float d[kOwn][3] = {}, l1 = 0.0f, squares = 0.0f;
#pragma unroll
  for (int c = 0; c < 3; ++c) {
    __syncthreads();
    load_slopes(p, slopes, c, area);
    __syncthreads();
    for (int g = static_cast<int>(threadIdx.x); g < 3 * kGroups; g += kThreads)
      blur_rows(area[g / kGroups], g % kGroups, rows[g / kGroups]);
    __syncthreads();
    float by[3][kOwn];
#pragma unroll
    for (int m = 0; m < 3; ++m) column_sums(rows[m], by[m]);
#pragma unroll
    for (int own = 0; own < kOwn; ++own) {
      const OwnPixel pixel = own_pixel(own, p.width, p.height);
      if (!pixel.inside) continue;
      const float x = corrected(p.rendered[pixel.at], map, c);
      const float y = ground_truth_value(p, pixel.at, c);
      const float slope = fmaf(2.0f * x, by[1][own], fmaf(y, by[2][own], by[0][own]));
      const float difference = x - y;
      const float sign = difference == 0.0f ? 0.0f : copysignf(l1_scale, difference);
      d[own][c] = fmaf(ssim_scale, slope, sign);
      l1 += fabsf(difference);
      squares = fmaf(difference, difference, squares);
    }
  }
  float by_map[12] = {};
  write_gradient(p, map, d, error, d_image, by_map);
  const std::size_t blocks = std::size_t{gridDim.x} * gridDim.y;
  const std::size_t block = blockIdx.y * gridDim.x + blockIdx.x;
  l1 = block_sum<kThreads>(l1);
  if (threadIdx.x == 0) sums[block] = l1;
#pragma unroll
  for (int k = 0; k < 12; ++k) {
    const float sum = block_sum<kThreads>(by_map[k]);
    if (threadIdx.x == 0) sums[(k + 1) * blocks + block] = sum;
  }
  squares = block_sum<kThreads>(squares);
  if (threadIdx.x == 0) sums[(kLossSums - 1) * blocks + block] = squares;
}

}  // namespace

void launch_image_loss(const View& view, const std::uint8_t* ground_truth, const float* colour_map,
                       const LossWeights& weights, const Workspace& w, cudaStream_t stream) {
  const ImagePair images{w.image,    ground_truth, colour_map,
                         view.width, view.height,  view.background};
  const double values = 3.0 * view.width * view.height;
  const dim3 blocks(loss_blocks_x(view), loss_blocks_y(view));
  ssim_forward<<<blocks, kThreads, 0, stream>>>(images, w.slopes, w.error, w.ssim_sums);
  loss_gradient<<<blocks, kThreads, 0, stream>>>(
      images, w.slopes, w.error, static_cast<float>(weights.l1 / values),
      static_cast<float>(-weights.ssim / values), w.d_image, w.loss_sums);
}

}  // namespace stgs::encoder::cuda
