// SPDX-License-Identifier: Apache-2.0
#include "arguments.h"

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>

namespace stgs::tools {

Argument* Argument::required() {
  option_->required();
  return this;
}

Argument* Argument::check(const ArgumentCheck& check) {
  option_->check(check);
  return this;
}

Argument* Argument::check(const OneOf& check) {
  option_->check(CLI::IsMember(check.words));
  return this;
}

Argument* Argument::needs(Argument* other) {
  option_->needs(other->option_);
  return this;
}

Argument* Argument::excludes(Argument* other) {
  option_->excludes(other->option_);
  return this;
}

Argument* Argument::expected(int values) {
  option_->expected(values);
  return this;
}

Argument* Argument::delimiter(char between) {
  option_->delimiter(between);
  return this;
}

Argument* Argument::allow_extra_args(bool allow) {
  option_->allow_extra_args(allow);
  return this;
}

Argument* Argument::group(const std::string& name) {
  option_->group(name);
  return this;
}

Argument* Argument::capture_default_str() {
  option_->capture_default_str();
  return this;
}

std::size_t Argument::count() const {
  return option_->count();
}

template <class T>
Argument* Arguments::add_option(const std::string& name, T& value, const std::string& help) {
  return keep(app_.add_option(name, value, help));
}

#define STGS_ARGUMENT(T) \
  template Argument* Arguments::add_option(const std::string&, T&, const std::string&)
STGS_ARGUMENT(std::string);
STGS_ARGUMENT(int);
STGS_ARGUMENT(double);
STGS_ARGUMENT(std::optional<double>);
STGS_ARGUMENT(std::optional<float>);
STGS_ARGUMENT(std::optional<std::string>);
STGS_ARGUMENT(std::optional<std::uint32_t>);
STGS_ARGUMENT(std::optional<std::uint64_t>);
STGS_ARGUMENT(std::vector<std::string>);
STGS_ARGUMENT(std::vector<float>);
#undef STGS_ARGUMENT

Argument* Arguments::add_flag(const std::string& name, bool& value, const std::string& help) {
  return keep(app_.add_flag(name, value, help));
}

void Arguments::allow_extras() {
  app_.allow_extras();
}

Argument* Arguments::keep(CLI::Option* option) {
  return &arguments_.emplace_back(option);
}

}  // namespace stgs::tools
