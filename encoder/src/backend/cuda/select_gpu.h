// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

// Makes GPU `gpu`, modulo the number of GPUs, that of the calling thread. kUnsupported if there is
// no usable one, or this build has no code for it.
Result<cudaDeviceProp> select_gpu(int gpu);

}  // namespace stgs::encoder::cuda
