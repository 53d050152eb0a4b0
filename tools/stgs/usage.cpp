// SPDX-License-Identifier: Apache-2.0
#include "usage.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <regex>
#include <string_view>

#include "config_file.h"
#include "options.h"
#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

// Returns the long option names of an app, with their dashes.
std::vector<std::string> option_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

// The verb on the command line; the program itself if there is none.
const CLI::App& parsed_app(const CLI::App& app) {
  const auto verbs = app.get_subcommands();
  return verbs.empty() ? app : *verbs.front();
}

std::string full_name(const CLI::App& app) {
  return app.get_parent() == nullptr ? app.get_name() : "stgs " + app.get_name();
}

// Returns the required arguments of an app, for example "stgs pack SCENE... -o FILE".
std::string synopsis(const CLI::App& app) {
  std::string text = full_name(app), options;
  for (const CLI::Option* option : app.get_options()) {
    const bool several = option->get_items_expected_max() > 1;
    if (option->get_positional()) {
      text += fmt::format(" {}{}", option->get_name(true), several ? "..." : "");
    } else if (option->get_required()) {
      const auto& letters = option->get_snames();
      options += fmt::format(
          " {} {}", letters.empty() ? "--" + option->get_lnames().front() : "-" + letters[0],
          option->check_lname("output") ? "OUTPUT" : "VALUE");
    }
  }
  return text + options;
}

// "Could not convert: --iterations = 1e3"
std::string conversion_message(const std::string& message) {
  static const std::regex form(R"(Could not convert: (\S+) = ([^]*))");
  std::smatch found;
  if (!std::regex_match(message, found, form)) return message;
  const std::string value = found[2];
  std::string text = fmt::format("{}: '{}' is not an integer", found[1].str(), value);
  char* end = nullptr;
  const double number = std::strtod(value.c_str(), &end);
  const bool is_whole = end != value.c_str() && *end == '\0' && std::abs(number) < 1e15 &&
                        number == std::floor(number);
  if (is_whole) text += fmt::format("; write {:.0f}", number);
  return text;
}

// "--size: At Most 1 required but received 2" and "--size: 1 required TEXT missing"
std::string count_message(const std::string& message) {
  if (const std::size_t at = message.find(": At Most 1 required"); at != std::string::npos) {
    return message.substr(0, at) + " is given more than once";
  }
  static const std::regex missing(R"((\S+): (\d+) required (?:\w+)[^]* missing)");
  std::smatch found;
  if (!std::regex_match(message, found, missing)) return message;
  return fmt::format("{} needs {}", found[1].str(),
                     found[2] == "1" ? std::string("a value") : found[2].str() + " values");
}

std::string unknown_option_message(const CLI::App& app, const std::string& argument) {
  // A part of a URL does not show where its password ends.
  const std::string shown = player::display_location(argument);
  const std::string name = shown.substr(0, shown.find('='));
  const std::string near = nearest_word(name, option_names(app));
  return fmt::format("unknown option '{}'{}", name,
                     near.empty() ? "" : fmt::format("; did you mean '{}'?", near));
}

// The file of --config, or "".
std::string config_file(const CLI::App& app) {
  const CLI::Option* option = app.get_config_ptr();
  return option->count() > 0 ? option->results().front() : "";
}

const ConfigFile& config_reader(const CLI::App& app) {
  return dynamic_cast<const ConfigFile&>(*app.get_config_formatter());
}

// Returns "x.toml:3", for messages.
std::string config_place(const CLI::App& app, const std::string& key) {
  const std::string file = config_file(app);
  const int line = config_reader(app).line_of(key);
  return line == 0 ? file : fmt::format("{}:{}", file, line);
}

// "INI was not able to parse render.bogus" and "none.toml was not readable (missing?)"
std::string config_message(const CLI::App& app, const std::string& message) {
  const std::string& problem = config_reader(app).problem();
  if (!problem.empty()) return fmt::format("--config {}{}", config_file(app), problem);
  const std::string_view unparsed = "INI was not able to parse ";
  if (message.rfind(unparsed, 0) != 0)
    return fmt::format("--config {}: cannot read the file", config_file(app));
  const std::string key = message.substr(unparsed.size());
  return fmt::format(
      "--config {}: unknown option '{}'; write the options of a verb as NAME = VALUE in the "
      "section [VERB]",
      config_place(app, key), key);
}

// Adds the place to "--size: '5' is not a size" if the value is from the file of --config.
std::string with_config_place(const CLI::App& app, const CLI::App& verb,
                              const std::string& message) {
  const std::string option = message.substr(0, message.find(':'));
  if (config_file(app).empty() || option.rfind("--", 0) != 0) return message;
  const std::string key = fmt::format("{}.{}", verb.get_name(), option.substr(2));
  const bool is_from_file = config_reader(app).line_of(key) != 0;
  return is_from_file ? fmt::format("--config {}: {}", config_place(app, key), message) : message;
}

bool is_option(const std::string& argument) {
  return argument.size() > 1 && argument[0] == '-';
}

}  // namespace

CLI::Option* with_choices(CLI::Option* option, std::vector<std::string> choices) {
  const std::string listed = fmt::format("{{{}}}", fmt::join(choices, ","));
  const auto check = [choices = std::move(choices)](const std::string& text) -> std::string {
    if (std::find(choices.begin(), choices.end(), text) != choices.end()) return {};
    const std::string near = nearest_word(text, choices);
    return fmt::format("'{}' is not one of {}{}", text, fmt::join(choices, ", "),
                       near.empty() ? "" : fmt::format("; did you mean '{}'?", near));
  };
  return option->check(check, listed);
}

Argument* with_choices(Argument* argument, std::vector<std::string> choices) {
  with_choices(argument->option(), std::move(choices));
  return argument;
}

std::string usage_message(const CLI::App& app, const CLI::ParseError& error) {
  const CLI::App& parsed = parsed_app(app);
  std::string message = error.what();
  std::vector<std::string> extras = parsed.remaining();
  if (extras.empty()) extras = app.remaining();
  const auto unknown = std::find_if(extras.begin(), extras.end(), is_option);
  if (unknown != extras.end()) {
    message = unknown_option_message(parsed, *unknown);
  } else if (error.get_name() == "ConfigError" || error.get_name() == "FileError") {
    message = config_message(app, message);
  } else if (error.get_name() == "RequiredError") {
    message += "; usage: " + synopsis(parsed);
  } else if (!extras.empty()) {
    message = fmt::format("unexpected argument '{}'; usage: {}", extras.front(), synopsis(parsed));
  } else if (error.get_name() == "ConversionError") {
    message = conversion_message(message);
  } else if (error.get_name() == "ArgumentMismatch") {
    message = count_message(message);
  }
  // CLI11 does not name --config, which has no group: its check does.
  if (message.starts_with(": ")) message.erase(0, 2);
  const bool is_value =
      error.get_name() == "ValidationError" || error.get_name() == "ConversionError";
  if (is_value) message = with_config_place(app, parsed, message);
  return fmt::format("{} (see '{} --help')", message, full_name(parsed));
}

std::string empty_value_message(const CLI::App& verb) {
  for (const CLI::Option* option : verb.get_options()) {
    const auto& values = option->results();
    if (option->count() == 0 || std::find(values.begin(), values.end(), "") == values.end())
      continue;
    return fmt::format("{} is empty (see '{} --help')", option->get_name(), full_name(verb));
  }
  return {};
}

std::string unknown_verb_message(const std::string& word, const std::vector<std::string>& verbs) {
  const std::string near = nearest_word(word, verbs);
  if (!near.empty()) return fmt::format("unknown verb '{}'; did you mean '{}'?", word, near);
  return fmt::format("unknown verb '{}'; the verbs are {}", word, fmt::join(verbs, ", "));
}

}  // namespace stgs::tools
