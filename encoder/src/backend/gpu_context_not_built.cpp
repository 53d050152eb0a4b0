// SPDX-License-Identifier: Apache-2.0
#include "backend/gpu_context.h"

namespace stgs::encoder {

Result<GpuContext> gpu_context(int) {
  return not_built("this build has no CUDA support");
}

}  // namespace stgs::encoder
