// SPDX-License-Identifier: Apache-2.0
// The GPU of the encoder, for libraries that share its CUDA context.
#pragma once

#include <cstddef>
#include <string>

#include "stgs/format/status.h"

namespace stgs::encoder {

struct GpuContext {
  std::string name;
  void* context = nullptr;     // CUcontext, valid until the process ends
  std::size_t free_bytes = 0;  // of device memory, now
};

// Returns the context of GPU number `gpu` modulo the number of GPUs, which all kernels use.
// kNotBuilt without CUDA, kUnsupported without a GPU.
Result<GpuContext> gpu_context(int gpu);

}  // namespace stgs::encoder
