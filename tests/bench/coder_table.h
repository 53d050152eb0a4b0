// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "stgs/format/scene_file.h"

namespace stgs::bench {

// Measures each coder on each attribute of the scene, quantised at quality 85 as one record: bits
// per primitive (tables included) and millions of primitives per second, encoded and decoded, on
// the calling thread's pool. The planes are those that the encoder passes to the coder.
nlohmann::json coder_table(const Scene& scene);

}  // namespace stgs::bench
