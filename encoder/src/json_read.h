// SPDX-License-Identifier: Apache-2.0
// Reads integers from JSON of other programs without rounding.
#pragma once

#include <cmath>
#include <string>

#include "stgs/format/json_text.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Returns a JSON number that is an integer in [min, max]; 1920.0 is one, 1.5 is not. Both limits
// must be exact as double. kInvalidFile begins with `where` and names `key`.
template <typename T, typename Json>
Result<T> exact_value(const Json& value, T min, T max, const std::string& key,
                      const std::string& where) {
  if (value.is_number()) {
    const double number = value.template get<double>();
    const bool fits = number >= static_cast<double>(min) && number <= static_cast<double>(max);
    if (fits && std::floor(number) == number) return static_cast<T>(number);
  }
  return invalid_file("{}: \"{}\" is {} (expected an integer from {} to {})", where, key,
                      short_json(value), min, max);
}

// As exact_value() for a member of an object. kInvalidFile if it is missing.
template <typename T, typename Json>
Result<T> exact(const Json& object, const char* key, T min, T max, const std::string& where) {
  const auto entry = object.find(key);
  if (entry == object.end()) return invalid_file("{}: \"{}\" is missing", where, key);
  return exact_value<T>(*entry, min, max, key, where);
}

}  // namespace stgs::encoder
