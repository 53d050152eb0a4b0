// SPDX-License-Identifier: Apache-2.0
// The gradient of the camera (math/camera_grad.h): one thread per primitive, summed per block, then
// over the blocks, in an order that depends only on the number of primitives.
#include "backend/cuda/splat_sums.cuh"
#include "math/camera_grad.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

__device__ CameraGrad camera_gradient_of(const Primitives& p, std::uint32_t i, const View& view,
                                         const ScreenSplat& splat, const Sums& sums) {
  const Sym2 conic = conic_of(splat.falloff);
  const float opacity = exp2f(splat.peak);
  const SplatGradient grad = splat_gradient(sums, conic, opacity);
  const PrimitiveValues own = load_values(p, i);
  const Pose pose = pose_of(own, view);
  const Vec3 from_camera{pose.position.x - view.centre.x, pose.position.y - view.centre.y,
                         pose.position.z - view.centre.z};
  const float inverse_length = 1.0f / sqrtf(dot3(from_camera, from_camera));
  const Vec3 by_colour = by_direction(p.rendered.sh + std::size_t{3} * p.sh_coefficients * i,
                                      view.coefficients, vec3_scale(from_camera, inverse_length),
                                      inverse_length, unclamped(splat, grad.colour));
  const Sym3 covariance = covariance_of(pose.rotation, pose.scale);
  const float visible = visibility(pose.dt, own.sigma, own.radius);
  const SplatShapeGrad by_shape =
      shape_gradient(view, grad, opacity, opacity_of(own.logit) * visible);
  const ProjectionGrad by_projection =
      project_gaussian_grad(view.camera, pose.position, covariance, conic, by_shape);
  CameraGrad out = project_gaussian_camera_grad(view.camera, pose.position, covariance, conic,
                                                by_shape, by_projection, by_colour);
  const Vec3 by_position = vec3_add(by_projection.position, by_colour);
  const float by_visibility = grad.opacity * opacity / visible;
  out.time = position_at_grad(own.u, pose.dt, by_position).dt +
             visibility_grad(pose.dt, own.sigma, own.radius, by_visibility).dt;
  return out;
}

__global__ void __launch_bounds__(kUpdateBlock)
    sum_blocks(const Primitives p, const View view, const Workspace w) {
  const std::uint32_t i = blockIdx.x * kUpdateBlock + threadIdx.x;
  const bool own = w.counters->overflow == 0 && i < p.n && w.depth_keys[i] != kInvisible;
  CameraGrad grad{};
  if (own) grad = camera_gradient_of(p, i, view, load_splat(w.splats, i), load_sums(w, i));
  const float values[kCameraValues] = {grad.rotation.x,    grad.rotation.y,    grad.rotation.z,
                                       grad.translation.x, grad.translation.y, grad.translation.z,
                                       grad.log_focal,     grad.distortion,    grad.time};
  for (int k = 0; k < kCameraValues; ++k) {
    const float sum = block_sum<kUpdateBlock>(values[k]);
    if (threadIdx.x == 0) w.camera_sums[kCameraValues * (1 + blockIdx.x) + k] = sum;
  }
}

// One warp per value.
__global__ void sum_all(std::uint32_t blocks, float* sums) {
  const std::uint32_t k = threadIdx.x / 32;
  double sum = 0.0;
  for (std::uint32_t block = threadIdx.x & 31; block < blocks; block += 32)
    sum += sums[kCameraValues * (1 + block) + k];
  sum = warp_sum(sum);
  if ((threadIdx.x & 31) == 0) sums[k] = static_cast<float>(sum);
}

}  // namespace

void launch_camera_gradient(const Primitives& p, const View& view, const Workspace& w,
                            cudaStream_t stream) {
  const int blocks = blocks_of(p.n, kUpdateBlock);
  sum_blocks<<<blocks, kUpdateBlock, 0, stream>>>(p, view, w);
  sum_all<<<1, 32 * kCameraValues, 0, stream>>>(static_cast<std::uint32_t>(blocks), w.camera_sums);
}

}  // namespace stgs::encoder::cuda
