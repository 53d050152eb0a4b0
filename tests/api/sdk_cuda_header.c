/* SPDX-License-Identifier: Apache-2.0 */
/* The header needs nothing before it, and may be there twice. */
#include "stgs/stgs_cuda.h"

#include "stgs/stgs_cuda.h"

stgs_result cuda_of_library(stgs_renderer* renderer);
stgs_result cuda_of_library(stgs_renderer* renderer) {
  return stgs_cuda_render(renderer, NULL, 0, NULL, NULL, 0, NULL);
}
