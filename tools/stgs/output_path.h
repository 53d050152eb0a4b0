// SPDX-License-Identifier: Apache-2.0
// Checks of output paths before long work.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/output_file.h"
#include "stgs/format/output_path.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Returns the temporary folder of this process for an output at `path`.
std::string work_name(const std::string& path);
// Removes work folders of `path` whose process on this machine has ended, and returns their names.
// Folders that cannot be removed stay.
std::vector<std::string> remove_stale_work(const std::string& path);
// Returns kUsage if the extension of an output `path` is that of another known format. `verb` and
// `extension`, for example "train" and ".stgs", are for the message; "" for a verb that writes a
// folder. Unknown extensions and names without one pass.
Status check_extension(const std::string& path, const char* verb, const std::string& extension);
// As check_can_write(), for a new or existing folder.
Status check_can_make_folder(const std::string& path);
// Returns whether `path` is a direct child of a folder that does not exist yet.
bool is_in_new_folder(const std::string& path, const std::string& folder);

}  // namespace stgs::tools
