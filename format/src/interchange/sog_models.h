// SPDX-License-Identifier: Apache-2.0
// Locations of SOG models, and their kinds.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/read_limits.h"
#include "stgs/format/status.h"

namespace stgs {

// Returns the models at a path, at least one, in name order. The path is a bundle, a meta.json, a
// folder with a meta.json, or a folder of such folders and bundles.
Result<std::vector<std::string>> sog_models(const std::string& path);
// Returns whether a folder contains such models, or a streamed set of them.
bool is_sog_folder(const std::string& folder);

// The formats that are a zip archive with a meta.json.
enum class SogKind { kSog, kSogst, kTsog };
// Returns the kind of an archive by its meta.json; by its extension if that cannot be read within
// the limits.
SogKind sog_kind(const std::string& path, const ReadLimits& limits);
// Returns the kind of a name by its extension.
SogKind sog_kind_of_extension(const std::string& path);

}  // namespace stgs
