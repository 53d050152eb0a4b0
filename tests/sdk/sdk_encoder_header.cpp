// SPDX-License-Identifier: Apache-2.0
// The header is self-contained and can be included twice.
#include "stgs/stgs_encoder.h"

#include "stgs/stgs_encoder.h"

void call_encoder_from_cpp(stgs_encoder* encoder);
void call_encoder_from_cpp(stgs_encoder* encoder) {
  stgs_encoder_cancel(encoder);
}
