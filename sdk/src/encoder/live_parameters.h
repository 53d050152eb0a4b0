// SPDX-License-Identifier: Apache-2.0
// The table (stgs/format/parameter.h) of stgs_live_settings.
#pragma once

#include "stgs/encoder/live_encoder.h"

namespace stgs::sdk {

struct LiveParameters {
  template <typename Visit>
  static void for_each(Visit visit) {
    visit(encoder::kLiveFps, STGS_MEMBER(fps));
    STGS_VISIT(visit, scale, 0.01, 1, "Scale factor of the images");
    visit(encoder::kLiveLatency, STGS_MEMBER(latency));
    visit(encoder::kLiveKbps, STGS_MEMBER(target_kbps));
    STGS_VISIT(visit, start_seconds, 0.1, 3600, "Time to wait for all cameras", "seconds");
    STGS_VISIT(visit, iterations, 1, 1e8, "Maximum number of training views per window", "",
               "the value of the preset");
    STGS_VISIT(visit, max_primitives, 1, 2e8, "Maximum number of primitives of a window", "",
               "the value of the preset");
  }
};

}  // namespace stgs::sdk
