// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "stgs/encoder/pack.h"

namespace stgs::encoder {

// Applies the settings of unit, up, floor and audio to the metadata. kUsage for an up vector
// without direction, or a floor without up vector.
Status apply_metadata(const PackSettings& settings, SceneMetadata& metadata);

}  // namespace stgs::encoder
