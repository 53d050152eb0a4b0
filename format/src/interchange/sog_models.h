// SPDX-License-Identifier: Apache-2.0
// Where SOG models lie.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

// The models that a path stands for: a bundle, a meta.json, a folder with one, or a folder of such
// folders and bundles, in the order of their names. At least one.
Result<std::vector<std::string>> sog_models(const std::string& path);
// Whether a folder holds such models, or a streamed set of them.
bool is_sog_folder(const std::string& folder);

}  // namespace stgs
