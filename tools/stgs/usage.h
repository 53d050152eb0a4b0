// SPDX-License-Identifier: Apache-2.0
// Messages for wrong command lines, and checks of option values.
#pragma once

#include <string>
#include <vector>

#include "arguments.h"

namespace CLI {
class App;
class Option;
class ParseError;
}  // namespace CLI

namespace stgs::tools {

// Restricts an option to `choices`, which --help lists as {a,b,c}. Returns the option.
CLI::Option* with_choices(CLI::Option* option, std::vector<std::string> choices);
Argument* with_choices(Argument* argument, std::vector<std::string> choices);

// Returns the message for a command line that CLI11 rejected: names the argument and the values or
// the option that fit, and refers to the help.
std::string usage_message(const CLI::App& app, const CLI::ParseError& error);

// Returns the message if an option or positional of the parsed verb has an empty value; else "".
std::string empty_value_message(const CLI::App& verb);

// Returns the message for a first argument that is no verb.
std::string unknown_verb_message(const std::string& word, const std::vector<std::string>& verbs);

}  // namespace stgs::tools
