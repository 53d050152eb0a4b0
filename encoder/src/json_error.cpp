// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/json_error.h"

#include <nlohmann/json.hpp>

namespace stgs::encoder {

std::string json_error(const std::exception& error) {
  std::string text = error.what();
  if (dynamic_cast<const nlohmann::json::exception*>(&error) == nullptr) return text;
  // "[json.exception.out_of_range.403] key 'height' not found"
  const std::size_t end = text.find("] ");
  return end == std::string::npos ? text : text.substr(end + 2);
}

}  // namespace stgs::encoder
