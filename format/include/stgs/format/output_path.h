// SPDX-License-Identifier: Apache-2.0
// Checks of output paths before long work starts, so that it cannot fail at the end.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

// Checks that a file can be created at `path`: its folder exists and is writable, and the path is
// free or names a regular file.
Status check_can_write(const std::string& path);
// Removes files that temporary_name(path) named for processes that ended on this machine without
// removing them. Returns their names. Files that cannot be removed stay.
std::vector<std::string> remove_stale_files(const std::string& path);

// A path, and the option or setting that it comes from; both appear in messages.
struct NamedPath {
  std::string option, path;
};
// Returns kUsage if two paths lead to the same file or folder, after resolving links and dots.
// Empty paths are ignored.
Status check_distinct(const std::vector<NamedPath>& paths);

}  // namespace stgs
