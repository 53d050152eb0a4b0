/* SPDX-License-Identifier: Apache-2.0 */
/* The header needs nothing before it, and may be there twice. */
#include "stgs/stgs_encoder.h"

#include "stgs/stgs_encoder.h"

void cancel_an_encoder(stgs_encoder* encoder);
void cancel_an_encoder(stgs_encoder* encoder) {
  stgs_encoder_cancel(encoder);
}
