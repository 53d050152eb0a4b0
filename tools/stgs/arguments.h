// SPDX-License-Identifier: Apache-2.0
// The command-line arguments of a verb: a narrow interface to CLI11, whose header takes seconds to
// compile.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace stgs::tools {

// Empty if the text is acceptable, else the reason.
using ArgumentCheck = std::function<std::string(const std::string&)>;

// A check that accepts a few words; the help lists them.
struct OneOf {
  std::vector<std::string> words;
};

// An option or a positional argument. The setters return `this`, so that calls can be chained.
class Argument {
 public:
  explicit Argument(CLI::Option* option) : option_(option) {}
  Argument* required();
  Argument* check(const ArgumentCheck& check);
  Argument* check(const OneOf& check);
  Argument* needs(Argument* other);
  Argument* excludes(Argument* other);
  Argument* expected(int values);
  Argument* delimiter(char between);
  Argument* allow_extra_args(bool allow);
  // The heading in the help.
  Argument* group(const std::string& name);
  // Shows the present value of the variable as the default in the help.
  Argument* capture_default_str();
  // How often it was given, after parsing.
  std::size_t count() const;
  CLI::Option* option() const { return option_; }

 private:
  CLI::Option* option_;
};

class Arguments {
 public:
  explicit Arguments(CLI::App& app) : app_(app) {}
  Arguments(const Arguments&) = delete;
  Arguments& operator=(const Arguments&) = delete;

  // `name` is "FILE" for a positional argument, else "-o,--output". Parsing sets `value`, which
  // must outlive it. The result lives as long as this object. arguments.cpp lists the types.
  template <class T>
  Argument* add_option(const std::string& name, T& value, const std::string& help);
  Argument* add_flag(const std::string& name, bool& value, const std::string& help);
  // Accepts arguments that are not declared.
  void allow_extras();
  const CLI::App& app() const { return app_; }

 private:
  Argument* keep(CLI::Option* option);

  CLI::App& app_;
  std::deque<Argument> arguments_;
};

}  // namespace stgs::tools
