// SPDX-License-Identifier: Apache-2.0
// Checks of output paths before long work starts, so that it cannot fail at the end.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "stgs/format/status.h"
#include "stgs/format/temporary.h"

namespace stgs {

// Checks that a file can be created at `path`: its folder exists and is writable, and the path is
// free or names a regular file.
Status check_can_write(const std::string& path);
// Removes what killed runs with the output `path` have left (temporary.h), and reports each file
// and folder to `log`, which may be empty, at level 2.
void clear_leftovers(const std::string& path,
                     const std::function<void(int, const std::string&)>& log);
// check_can_write(), then clear_leftovers(). kUsage if another run writes `path`; none does as long
// as `lock`, which must be new, exists.
Status prepare_output(const std::string& path, OutputLock& lock,
                      const std::function<void(int, const std::string&)>& log);

// A path, and the option or setting that it comes from; both appear in messages.
struct NamedPath {
  std::string option, path;
};
// Returns kUsage if two paths lead to the same file or folder, after resolving links and dots.
// Empty paths are ignored.
Status check_distinct(const std::vector<NamedPath>& paths);

}  // namespace stgs
