// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "init/init.h"
#include "stgs/encoder/prepare.h"

namespace stgs::encoder {

// Returns the settings of the initialisation that follow from those of the preparation. `name`: of
// the capture, in messages.
inline InitSettings init_settings(const std::string& name, const PrepareSettings& settings) {
  InitSettings init;
  init.name = name;
  init.trust_calibration = settings.trust_calibration;
  init.separate_motion = settings.separate_motion;
  init.max_dynamic_points = settings.max_dynamic_points;
  init.max_static_points = settings.max_static_points;
  init.seed = settings.seed;
  init.backend = settings.backend;
  init.gpu = settings.share.index;
  return init;
}

}  // namespace stgs::encoder
