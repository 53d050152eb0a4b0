/* SPDX-License-Identifier: Apache-2.0 */
/* The header needs nothing before it, and may be there twice. */
#include "stgs/stgs.h"

#include "stgs/stgs.h"

uint32_t version_of_library_again(void);
uint32_t version_of_library_again(void) {
  return stgs_version();
}
