// SPDX-License-Identifier: Apache-2.0
// For functions that the host calls. Texts are UTF-8 and end with a zero byte.
#pragma once

#include <string>

#define STGS_EXPORT extern "C" __attribute__((used, visibility("default")))

namespace stgs::web {

// Returns a text to the host. It stays valid until the next call.
const char* give(std::string value);
// Returns a JSON string.
std::string quoted(const std::string& value);

}  // namespace stgs::web
