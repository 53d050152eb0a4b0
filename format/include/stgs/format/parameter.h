// SPDX-License-Identifier: Apache-2.0
// Tables of the numbers among the settings of an operation. A table states name, range, unit and
// description of each number once; the command line, the C interface, the checks and the reference
// (sdk/docs/parameters.md) read it. Defaults are the initialisers of the settings struct.
//
// A table is a struct with a static function template for_each(visit), which calls
// visit(parameter, member) once per number. member(settings) returns the number in any struct that
// has a member of this name: encoder::PackSettings and stgs_pack_settings, for example.
#pragma once

#include <string>
#include <type_traits>

#include "stgs/format/status.h"

namespace stgs {

// Describes a number among settings. Strings are static.
struct Parameter {
  const char* name;              // of the member
  double min, max;               // inclusive
  const char* help;              // without unit, range and default
  const char* unit = "";         // empty for counts and ratios
  const char* zero = nullptr;    // the meaning of 0, if 0 is not a value in [min, max]; else null
  const char* option = nullptr;  // of the command line; null: made from `name`

  bool accepts(double value) const {
    return (value >= min && value <= max) || (zero != nullptr && value == 0);
  }
  // Returns the accepted values: "0 to 100", "0 for no limit, or 0.001 to 1000000000".
  std::string range() const {
    const std::string values = fmt::format("{} to {}", min, max);
    return zero == nullptr ? values : fmt::format("0 for {}, or {}", zero, values);
  }
  // Returns the option: "--max-error" for max_error.
  std::string option_name() const;
};

// Checks a value. kUsage names the parameter, its range and the value.
inline Status check_parameter(const Parameter& parameter, double value) {
  if (parameter.accepts(value)) return {};
  return usage_error("invalid {} (expected {}, got {})", parameter.name, parameter.range(), value);
}

// Checks all numbers of a struct. kUsage names the first that is out of range.
template <typename Table, typename Settings>
Status check_parameters(const Settings& settings) {
  Status status;
  Table::for_each([&](const Parameter& parameter, auto member) {
    if (status.ok()) status = check_parameter(parameter, static_cast<double>(member(settings)));
  });
  return status;
}

// Copies all numbers of a table between two structs.
template <typename Table, typename From, typename To>
void copy_parameters(const From& from, To& to) {
  Table::for_each([&](const Parameter&, auto member) {
    member(to) = static_cast<std::remove_reference_t<decltype(member(to))>>(member(from));
  });
}

}  // namespace stgs

// Returns the member of this name of any struct.
#define STGS_MEMBER(name)       \
  [](auto& settings) -> auto& { \
    return settings.name;       \
  }
// Visits the row of a table for the member `name`; the rest are the members of Parameter after it.
#define STGS_VISIT(visit, name, ...) visit(::stgs::Parameter{#name, __VA_ARGS__}, STGS_MEMBER(name))
