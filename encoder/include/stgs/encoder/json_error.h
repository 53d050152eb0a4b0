// SPDX-License-Identifier: Apache-2.0
// What is wrong with a JSON file, for messages.
#pragma once

#include <exception>
#include <string>

namespace stgs::encoder {

// What the error says; of one of the JSON library without its prefix.
std::string json_error(const std::exception& error);

}  // namespace stgs::encoder
