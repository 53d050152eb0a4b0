// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "stgs/format/status.h"

namespace stgs::os {

// Opens a regular file for reading and returns its descriptor, which the caller owns. Never waits:
// pipes, sockets and devices are refused (kIo).
Result<int> open_regular(const std::string& path);

}  // namespace stgs::os
