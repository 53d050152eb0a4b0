// SPDX-License-Identifier: Apache-2.0
// Checks of output paths before long work.
#pragma once

#include <string>

#include "stgs/format/output_file.h"
#include "stgs/format/output_path.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Returns kUsage if the extension of an output `path` is that of another known format. `verb` and
// `extension`, for example "train" and ".stgs", are for the message; "" for a verb that writes a
// folder. Unknown extensions and names without one pass.
Status check_extension(const std::string& path, const char* verb, const std::string& extension);
// As check_can_write(), for a new or existing folder.
Status check_can_make_folder(const std::string& path);
// Returns whether `path` is a direct child of a folder that does not exist yet.
bool is_in_new_folder(const std::string& path, const std::string& folder);

}  // namespace stgs::tools
