// SPDX-License-Identifier: Apache-2.0
// The loss of train/image_loss.h, evaluated through the camera's colour map: L1 and SSIM with an 11
// x 11 zero-padded Gaussian window, channel by channel, rows then columns in shared memory. The
// first kernel computes the derivatives of SSIM with respect to the window means, the second blurs
// them into dL/dcolour. Each block writes its sums; the last kernel of the step adds them in order.
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

constexpr int kRadius = 5, kTaps = 2 * kRadius + 1;
constexpr int kAreaX = kLossX + 2 * kRadius, kAreaY = kLossY + 2 * kRadius;
constexpr int kArea = kAreaX * kAreaY;
constexpr int kThreads = 256;
constexpr int kOwn = kLossX * kLossY / kThreads;  // pixels per thread
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

// Loads the block's area of both images, 0 beyond the border.
__device__ void load_area(const ImagePair& p, float (&x)[3][kArea], float (&y)[3][kArea]) {
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
  __shared__ float x[3][kArea], y[3][kArea];
  __shared__ float rows[5][kAreaY * kLossX];
  load_area(p, x, y);
  const std::size_t pixels = static_cast<std::size_t>(p.width) * p.height;
  float ssim[kOwn] = {};
  for (int c = 0; c < 3; ++c) {
    __syncthreads();
    for (int q = static_cast<int>(threadIdx.x); q < kAreaY * kLossX; q += kThreads) {
      const int from = q / kLossX * kAreaX + q % kLossX;
      Means m{};
#pragma unroll
      for (int k = 0; k < kTaps; ++k) {
        const float a = x[c][from + k], b = y[c][from + k];
        const float wa = tap(k) * a, wb = tap(k) * b;
        m.x += wa;
        m.y += wb;
        m.xx = fmaf(wa, a, m.xx);
        m.yy = fmaf(wb, b, m.yy);
        m.xy = fmaf(wa, b, m.xy);
      }
      rows[0][q] = m.x;
      rows[1][q] = m.y;
      rows[2][q] = m.xx;
      rows[3][q] = m.yy;
      rows[4][q] = m.xy;
    }
    __syncthreads();
#pragma unroll
    for (int own = 0; own < kOwn; ++own) {
      const int q = static_cast<int>(threadIdx.x) + own * kThreads;
      const int px = static_cast<int>(blockIdx.x) * kLossX + q % kLossX;
      const int py = static_cast<int>(blockIdx.y) * kLossY + q / kLossX;
      if (px >= p.width || py >= p.height) continue;
      Means m{};
#pragma unroll
      for (int k = 0; k < kTaps; ++k) {
        const int from = q + k * kLossX;
        m.x = fmaf(tap(k), rows[0][from], m.x);
        m.y = fmaf(tap(k), rows[1][from], m.y);
        m.xx = fmaf(tap(k), rows[2][from], m.xx);
        m.yy = fmaf(tap(k), rows[3][from], m.yy);
        m.xy = fmaf(tap(k), rows[4][from], m.xy);
      }
      Slopes by;
      ssim[own] += ssim_of(m, by);
      const std::size_t at = static_cast<std::size_t>(py) * p.width + px;
      slopes[(3 * c) * pixels + at] = by.by_x;
      slopes[(3 * c + 1) * pixels + at] = by.by_xx;
      slopes[(3 * c + 2) * pixels + at] = by.by_xy;
    }
  }
  float sum = 0.0f;
#pragma unroll
  for (int own = 0; own < kOwn; ++own) {
    const int q = static_cast<int>(threadIdx.x) + own * kThreads;
    const int px = static_cast<int>(blockIdx.x) * kLossX + q % kLossX;
    const int py = static_cast<int>(blockIdx.y) * kLossY + q / kLossX;
    sum += ssim[own];
    if (px >= p.width || py >= p.height) continue;
    error[static_cast<std::size_t>(py) * p.width + px] =
        fminf(fmaxf(1.0f - ssim[own] * (1.0f / 3.0f), 0.0f), 1.0f);
  }
  sum = block_sum<kThreads>(sum);
  if (threadIdx.x == 0) sums[blockIdx.y * gridDim.x + blockIdx.x] = sum;
}

__global__ void __launch_bounds__(kThreads)
    loss_gradient(const ImagePair p, const float* slopes, const float* error, float l1_scale,
                  float ssim_scale, float4* d_image, float* sums) {
  __shared__ float area[3][kArea];
  __shared__ float rows[3][kAreaY * kLossX];
  const std::size_t pixels = static_cast<std::size_t>(p.width) * p.height;
  const int x0 = static_cast<int>(blockIdx.x) * kLossX, y0 = static_cast<int>(blockIdx.y) * kLossY;
  float map[12];
#pragma unroll
  for (int k = 0; k < 12; ++k) map[k] = p.map[k];
  float d[kOwn][3] = {}, l1 = 0.0f;
  for (int c = 0; c < 3; ++c) {
    __syncthreads();
    for (int q = static_cast<int>(threadIdx.x); q < kArea; q += kThreads) {
      const int px = x0 - kRadius + q % kAreaX, py = y0 - kRadius + q / kAreaX;
      const bool inside = px >= 0 && py >= 0 && px < p.width && py < p.height;
      const std::size_t at = inside ? static_cast<std::size_t>(py) * p.width + px : 0;
#pragma unroll
      for (int m = 0; m < 3; ++m) area[m][q] = inside ? slopes[(3 * c + m) * pixels + at] : 0.0f;
    }
    __syncthreads();
    for (int q = static_cast<int>(threadIdx.x); q < kAreaY * kLossX; q += kThreads) {
      const int from = q / kLossX * kAreaX + q % kLossX;
#pragma unroll
      for (int m = 0; m < 3; ++m) {
        float sum = 0.0f;
#pragma unroll
        for (int k = 0; k < kTaps; ++k) sum = fmaf(tap(k), area[m][from + k], sum);
        rows[m][q] = sum;
      }
    }
    __syncthreads();
#pragma unroll
    for (int own = 0; own < kOwn; ++own) {
      const int q = static_cast<int>(threadIdx.x) + own * kThreads;
      const int px = x0 + q % kLossX, py = y0 + q / kLossX;
      if (px >= p.width || py >= p.height) continue;
      float by[3];
#pragma unroll
      for (int m = 0; m < 3; ++m) {
        by[m] = 0.0f;
#pragma unroll
        for (int k = 0; k < kTaps; ++k) by[m] = fmaf(tap(k), rows[m][q + k * kLossX], by[m]);
      }
      const std::size_t at = static_cast<std::size_t>(py) * p.width + px;
      const float x = corrected(p.rendered[at], map, c), y = ground_truth_value(p, at, c);
      const float slope = fmaf(2.0f * x, by[1], fmaf(y, by[2], by[0]));
      const float difference = x - y;
      const float sign = difference == 0.0f ? 0.0f : copysignf(l1_scale, difference);
      d[own][c] = fmaf(ssim_scale, slope, sign);
      l1 += fabsf(difference);
    }
  }
  float by_map[12] = {};
#pragma unroll
  for (int own = 0; own < kOwn; ++own) {
    const int q = static_cast<int>(threadIdx.x) + own * kThreads;
    const int px = x0 + q % kLossX, py = y0 + q / kLossX;
    if (px >= p.width || py >= p.height) continue;
    const std::size_t at = static_cast<std::size_t>(py) * p.width + px;
    const float4 colour = mapped_part(p.background, p.rendered[at]);
    const float(&g)[3] = d[own];
    d_image[at] = make_float4(map[0] * g[0] + map[3] * g[1] + map[6] * g[2],
                              map[1] * g[0] + map[4] * g[1] + map[7] * g[2],
                              map[2] * g[0] + map[5] * g[1] + map[8] * g[2], error[at]);
#pragma unroll
    for (int c = 0; c < 3; ++c) {
      by_map[3 * c] = fmaf(g[c], colour.x, by_map[3 * c]);
      by_map[3 * c + 1] = fmaf(g[c], colour.y, by_map[3 * c + 1]);
      by_map[3 * c + 2] = fmaf(g[c], colour.z, by_map[3 * c + 2]);
      by_map[9 + c] = fmaf(g[c], colour.w, by_map[9 + c]);
    }
  }
  const std::size_t blocks = std::size_t{gridDim.x} * gridDim.y;
  const std::size_t block = blockIdx.y * gridDim.x + blockIdx.x;
  l1 = block_sum<kThreads>(l1);
  if (threadIdx.x == 0) sums[block] = l1;
#pragma unroll
  for (int k = 0; k < 12; ++k) {
    const float sum = block_sum<kThreads>(by_map[k]);
    if (threadIdx.x == 0) sums[(k + 1) * blocks + block] = sum;
  }
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
