/* SPDX-License-Identifier: Apache-2.0 */
/* The header is self-contained and can be included twice. */
#include "stgs/stgs.h"

#include "stgs/stgs.h"

uint32_t call_library_from_c(void);
uint32_t call_library_from_c(void) {
  return stgs_version();
}
