// SPDX-License-Identifier: Apache-2.0
// Options made from a table of parameters (stgs/format/parameter.h).
#pragma once

#include <map>
#include <set>
#include <string>

#include "arguments.h"
#include "options.h"
#include "stgs/format/parameter.h"

namespace stgs::tools {

// Returns the help of a parameter: its description, unit, and meaning of the default.
std::string option_help(const Parameter& parameter);

// Declares an option for each number of a table, which parsing stores in `settings`. Its present
// value is the default. Returns the options by the names of the members. `others`: names for which
// another table of the verb has an option.
template <typename Table, typename Settings>
std::map<std::string, Argument*> declare_parameters(Arguments& app, Settings& settings,
                                                    const char* group,
                                                    const std::set<std::string>& others = {}) {
  std::map<std::string, Argument*> options;
  Table::for_each([&](const Parameter& parameter, auto member) {
    if (others.count(parameter.name) > 0) return;
    Argument* option =
        app.add_option(parameter.option_name(), member(settings), option_help(parameter))
            ->check(number_between(parameter.min, parameter.max))
            ->group(group);
    if (parameter.zero == nullptr) option->capture_default_str();
    options[parameter.name] = option;
  });
  return options;
}

}  // namespace stgs::tools
