// SPDX-License-Identifier: Apache-2.0
// The names in a folder. std::filesystem's iterators end the program when memory runs out.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs::os {

// Returns the names of a folder's entries, sorted, without "." and "..". kIoError if the folder
// cannot be read.
Result<std::vector<std::string>> list_folder(const std::string& folder);

}  // namespace stgs::os
