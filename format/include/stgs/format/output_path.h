// SPDX-License-Identifier: Apache-2.0
// What is asked of places before long work writes there, so that hours are not lost at the end.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

// Whether a file can be made at `path`: its folder exists and takes files, and nothing but a
// regular file is in the way.
Status check_can_write(const std::string& path);
// Removes the files that temporary_name(path) gave to processes that have ended without removing
// them, on this machine, and returns their names. What cannot be removed stays.
std::vector<std::string> remove_stale_files(const std::string& path);

// A path that an option or a setting gives, or that follows from one; both for messages.
struct NamedPath {
  std::string option, path;
};
// kUsage where two of them are one file or folder, whatever links and dots are in the way. Those
// with an empty path do not count.
Status check_distinct(const std::vector<NamedPath>& places);

}  // namespace stgs
