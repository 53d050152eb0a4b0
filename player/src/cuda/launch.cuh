// SPDX-License-Identifier: Apache-2.0
// Launches kernels.
#pragma once

#include <cuda_runtime.h>

namespace stgs::player::cuda {

// Launch errors are reported by cudaGetLastError().
template <typename... Parameters, typename... Arguments>
void launch(void (*kernel)(Parameters...), dim3 blocks, unsigned threads, cudaStream_t stream,
            Arguments... arguments) {
  kernel<<<blocks, threads, 0, stream>>>(arguments...);
}

}  // namespace stgs::player::cuda
