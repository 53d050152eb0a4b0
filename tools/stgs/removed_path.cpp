// SPDX-License-Identifier: Apache-2.0
#include "removed_path.h"

#include <filesystem>
#include <system_error>

namespace stgs::tools {

RemovedPath::~RemovedPath() {
  std::error_code ignored;  // a temporary that stays behind is not worth an error
  if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
}

}  // namespace stgs::tools
