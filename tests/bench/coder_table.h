// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "stgs/format/scene_file.h"

namespace stgs::bench {

// For each attribute of the scene, quantised at quality 85 as one record, and each coder: bits a
// primitive, tables included, and millions of primitives a second, coded and decoded, on the
// calling thread's pool. The planes are those that the coder would get.
nlohmann::json coder_table(const Scene& scene);

}  // namespace stgs::bench
