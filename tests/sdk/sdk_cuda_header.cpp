/* SPDX-License-Identifier: Apache-2.0 */
/* The header is self-contained and can be included twice. */
#include "stgs/stgs_cuda.h"

#include "stgs/stgs_cuda.h"

stgs_result call_cuda_from_cpp(stgs_renderer* renderer);
stgs_result call_cuda_from_cpp(stgs_renderer* renderer) {
  return stgs_cuda_render(renderer, NULL, 0, NULL, NULL, 0, NULL);
}
