// SPDX-License-Identifier: Apache-2.0
// L_n of train/normal_loss.h. The first kernel finds the range of the ground ground_truth's
// differences, which are integers, so that atomics give the same result in any order. The second
// processes a block's pixels with the depths of their neighbourhood in shared memory: first the
// terms and their gradients, including a border of one pixel, then the gradient of each pixel's
// depth from the terms around it.
#include "backend/cuda/device.cuh"
#include "math/grad.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kThreads = 256;
constexpr int kMaxDifference = 3 * 255;
constexpr int kDepthX = kLossX + 4, kDepthY = kLossY + 4;  // pixels whose depth a block requires
constexpr int kTermX = kLossX + 2, kTermY = kLossY + 2;    // pixels whose terms it requires
constexpr int kTerms = kTermX * kTermY;

struct Surface {
  const float4* plane;  // W x H
  const float4* image;  // W x H, for the transmittance
  const std::uint8_t* ground_truth;
  PinholeCamera camera;
  int width, height;
};

__device__ std::uint32_t image_difference(const Surface& s, int x, int y) {
  const std::size_t row = std::size_t{3} * s.width;
  const std::uint8_t* p = s.ground_truth + row * y + std::size_t{3} * x;
  int across = 0, down = 0;
#pragma unroll
  for (int c = 0; c < 3; ++c) {
    across += abs(int{p[c + 3]} - int{*(p + c - 3)});
    down += abs(int{p[c + row]} - int{*(p + c - row)});
  }
  return static_cast<std::uint32_t>(max(across, down));
}

__device__ bool within_border(const Surface& s, int x, int y) {
  return x >= 1 && y >= 1 && x < s.width - 1 && y < s.height - 1;
}

// Writes range[0]: the maximum difference; range[1]: kMaxDifference minus the minimum. Both must
// start at 0.
__global__ void __launch_bounds__(kThreads) find_range(const Surface s, std::uint32_t* range) {
  std::uint32_t max_difference = 0, inverted = 0;
  const int x0 = static_cast<int>(blockIdx.x) * kLossX, y0 = static_cast<int>(blockIdx.y) * kLossY;
  for (int q = static_cast<int>(threadIdx.x); q < kLossX * kLossY; q += kThreads) {
    const int x = x0 + q % kLossX, y = y0 + q / kLossX;
    if (!within_border(s, x, y)) continue;
    const std::uint32_t difference = image_difference(s, x, y);
    max_difference = max(max_difference, difference);
    inverted = max(inverted, kMaxDifference - difference);
  }
  max_difference = __reduce_max_sync(kAllLanes, max_difference);
  inverted = __reduce_max_sync(kAllLanes, inverted);
  if ((threadIdx.x & 31) != 0) return;
  atomicMax(range, max_difference);
  atomicMax(range + 1, inverted);
}

__device__ Plane plane_at(const Surface& s, std::size_t at) {
  const float4 p = s.plane[at];
  return {{p.x, p.y, p.z}, p.w};
}

__device__ Vec3 ray_of(const Surface& s, int x, int y) {
  return pixel_ray(s.camera, static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
}

// Loads a block's depths, starting two pixels left of and above its first pixel (x0, y0); 0 beyond
// the border.
__device__ void load_depths(const Surface& s, int x0, int y0, float (&depth)[kDepthX * kDepthY]) {
  for (int q = static_cast<int>(threadIdx.x); q < kDepthX * kDepthY; q += kThreads) {
    const int x = x0 - 2 + q % kDepthX, y = y0 - 2 + q / kDepthX;
    depth[q] = 0.0f;
    if (x < 0 || y < 0 || x >= s.width || y >= s.height) continue;
    const std::size_t at = static_cast<std::size_t>(y) * s.width + x;
    depth[q] = plane_depth(plane_at(s, at), 1.0f - s.image[at].w, ray_of(s, x, y));
  }
}

// Returns the term of pixel (x, y), whose depth is depth[0]; 0 if the pixel is excluded.
__device__ NormalTerm term_of(const Surface& s, int x, int y, const float* depth,
                              std::uint32_t min_difference, float unit) {
  const float above = depth[-kDepthX], below = depth[kDepthX], left = depth[-1], right = depth[1];
  if (!within_border(s, x, y) ||
      !(depth[0] > 0.0f && above > 0.0f && below > 0.0f && left > 0.0f && right > 0.0f))
    return {};
  const std::size_t at = static_cast<std::size_t>(y) * s.width + x;
  const Vec3 d =
      vec3_add(vec3_scale(ray_of(s, x, y + 1), below), vec3_scale(ray_of(s, x, y - 1), -above));
  const Vec3 r =
      vec3_add(vec3_scale(ray_of(s, x + 1, y), right), vec3_scale(ray_of(s, x - 1, y), -left));
  const float gradient = static_cast<float>(image_difference(s, x, y) - min_difference) * unit;
  return normal_term(plane_at(s, at).normal, 1.0f - s.image[at].w, d, r, flatness_weight(gradient));
}

__global__ void __launch_bounds__(kThreads)
    normal_loss(const Surface s, const std::uint32_t* range, float scale, float4* d_surface,
                float* sums) {
  __shared__ float depth[kDepthX * kDepthY];
  __shared__ float terms[9][kTerms];  // gradients of the normal, `down` and `right`
  const int x0 = static_cast<int>(blockIdx.x) * kLossX, y0 = static_cast<int>(blockIdx.y) * kLossY;
  load_depths(s, x0, y0, depth);
  const std::uint32_t max_difference = range[0], min_difference = kMaxDifference - range[1];
  const float unit = max_difference > min_difference
                         ? 1.0f / static_cast<float>(max_difference - min_difference)
                         : 0.0f;
  __syncthreads();
  float sum = 0.0f;
  for (int q = static_cast<int>(threadIdx.x); q < kTerms; q += kThreads) {
    const int tx = q % kTermX, ty = q / kTermX;
    const NormalTerm t = term_of(s, x0 - 1 + tx, y0 - 1 + ty, depth + (ty + 1) * kDepthX + tx + 1,
                                 min_difference, unit);
    const Vec3 parts[3] = {t.normal, t.down, t.right};
#pragma unroll
    for (int k = 0; k < 3; ++k) {
      terms[3 * k][q] = scale * parts[k].x;
      terms[3 * k + 1][q] = scale * parts[k].y;
      terms[3 * k + 2][q] = scale * parts[k].z;
    }
    if (tx >= 1 && ty >= 1 && tx <= kLossX && ty <= kLossY) sum += t.value;
  }
  __syncthreads();
  for (int q = static_cast<int>(threadIdx.x); q < kLossX * kLossY; q += kThreads) {
    const int bx = q % kLossX, by = q / kLossX, x = x0 + bx, y = y0 + by;
    if (x >= s.width || y >= s.height) continue;
    const std::size_t at = static_cast<std::size_t>(y) * s.width + x;
    const int own = (by + 1) * kTermX + bx + 1;
    const auto by_point = [&](int c) {
      return terms[3 + c][own - kTermX] - terms[3 + c][own + kTermX] + terms[6 + c][own - 1] -
             terms[6 + c][own + 1];
    };
    const Vec3 ray = ray_of(s, x, y);
    const Plane g = plane_depth_grad(plane_at(s, at), depth[(by + 2) * kDepthX + bx + 2], ray,
                                     dot3({by_point(0), by_point(1), by_point(2)}, ray));
    d_surface[at] = make_float4(terms[0][own] + g.normal.x, terms[1][own] + g.normal.y,
                                terms[2][own] + g.normal.z, g.distance);
  }
  sum = block_sum<kThreads>(sum);
  if (threadIdx.x == 0) sums[blockIdx.y * gridDim.x + blockIdx.x] = sum;
}

}  // namespace

void launch_normal_loss(const View& view, const std::uint8_t* ground_truth, float weight,
                        const Workspace& w, cudaStream_t stream) {
  const Surface s{w.surface, w.image, ground_truth, view.camera, view.width, view.height};
  const dim3 blocks(loss_blocks_x(view), loss_blocks_y(view));
  const float scale = weight / (static_cast<float>(view.width) * static_cast<float>(view.height));
  cudaMemsetAsync(w.difference_range, 0, 2 * sizeof(*w.difference_range), stream);
  find_range<<<blocks, kThreads, 0, stream>>>(s, w.difference_range);
  normal_loss<<<blocks, kThreads, 0, stream>>>(s, w.difference_range, scale, w.d_surface,
                                               w.normal_sums);
}

}  // namespace stgs::encoder::cuda
