// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace stgs::player::cuda {

// The arrays of Gaussians4D in device memory, with capacity for the primitives of a segment.
struct DeviceGaussians {
  float* position = nullptr;       // N x 3
  float* log_scale = nullptr;      // N x 3
  float* rotation = nullptr;       // N x 4
  float* opacity_logit = nullptr;  // N
  float* sh = nullptr;             // N x (sh_degree+1)^2 x 3
  float* time = nullptr;           // N
  float* velocity = nullptr;       // N x 3
  float* sigma = nullptr;          // N
  float* radius = nullptr;         // N
};

}  // namespace stgs::player::cuda
