// SPDX-License-Identifier: Apache-2.0
// The kernels of multi-view stereo (geometry/patch_match.h). All pointers are of device memory.
#pragma once

#include <cuda_runtime_api.h>

#include "geometry/patch_match.h"

namespace stgs::encoder::cuda {

// start_pixel() for all pixels.
void launch_stereo_start(const geometry::StereoProblem& problem, const geometry::PlaneMap& map,
                         std::uint64_t seed, cudaStream_t stream);

// update_pixel() for the pixels of one colour: those where x + y + colour is even.
void launch_stereo_update(const geometry::StereoProblem& problem, const geometry::PlaneMap& map,
                          int colour, int iteration, std::uint64_t seed, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
