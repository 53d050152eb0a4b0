// SPDX-License-Identifier: Apache-2.0
// Checked access to fields of JSON written by other programs.
#pragma once

#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "interchange/import_memory.h"
#include "stgs/format/json_text.h"
#include "stgs/format/status.h"

namespace stgs {

// Parses JSON of at most kMaxJsonNesting levels. `label` is for messages.
inline Result<Charged<nlohmann::json>> parse_json(std::span<const std::uint8_t> text,
                                                  const std::string& label, ImportMemory& memory) {
  STGS_TRY(check_json_nesting({reinterpret_cast<const char*>(text.data()), text.size()}, label));
  Charged<nlohmann::json> json;
  STGS_ASSIGN(json.lease, memory.take(kJsonBytesPerByte * text.size(),
                                      fmt::format("the values of {} bytes of JSON", text.size())));
  json.value = nlohmann::json::parse(text.begin(), text.end(), nullptr, false);
  if (json.value.is_discarded()) return invalid_file("{}: not valid JSON", label);
  return json;
}

// Returns the member of an object, or null if there is none.
inline const nlohmann::json& member(const nlohmann::json& object, const char* name) {
  static const nlohmann::json none;
  if (!object.is_object()) return none;
  const auto found = object.find(name);
  return found == object.end() ? none : *found;
}

// Returns a list of `count` numbers that are finite in binary32.
inline Result<std::vector<double>> number_list(const nlohmann::json& list, std::size_t count,
                                               const std::string& label) {
  if (!list.is_array() || list.size() != count) {
    return invalid_file("{}: expected a list of {} numbers", label, count);
  }
  std::vector<double> out;
  out.reserve(count);
  for (const nlohmann::json& item : list) {
    const double value = item.is_number() ? item.get<double>() : NAN;
    if (!std::isfinite(static_cast<float>(value))) {
      return invalid_file("{}[{}]: expected a finite number", label, out.size());
    }
    out.push_back(value);
  }
  return out;
}

}  // namespace stgs
