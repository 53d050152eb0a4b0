// SPDX-License-Identifier: Apache-2.0
// Loads the coupled form of 4DGS (math/coupled.h) and writes its gradients to the update's stage.
#pragma once

#include "backend/cuda/update_rows.cuh"
#include "math/coupled.h"

namespace stgs::encoder::cuda {

__device__ inline math::Coupled load_coupled(const Primitives& p, std::uint32_t i) {
  const float4 left = reinterpret_cast<const float4*>(p.values[kRotation])[i];
  const float4 right = reinterpret_cast<const float4*>(p.values[kVelocity])[i];
  const math::Vec3 s = read3(p.values[kLogScale], i);
  return {{left.x, left.y, left.z, left.w},
          {right.x, right.y, right.z, right.w},
          expf(p.values[kLogSigma][i]),
          {expf(s.x), expf(s.y), expf(s.z)}};
}

__device__ inline void write4(float* to, math::Quat q) {
  to[0] = q.w;
  to[1] = q.x;
  to[2] = q.y;
  to[3] = q.z;
}

// Writes the gradients of the parameters, those of the standard deviations with respect to their
// logarithms.
__device__ inline void write_coupled(float* stage, const math::Coupled& by) {
  write3(stage + kByLogScale, by.scale);
  write4(stage + kByRotation, by.left);
  write4(stage + kByRight, by.right);
  stage[kByLogTime] = by.time;
}

}  // namespace stgs::encoder::cuda
