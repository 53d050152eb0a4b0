// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>

#include "command.h"
#include "usage.h"

namespace stgs::tools {
namespace {

class ShowHelp final : public Command {
 public:
  Help help() const override {
    return {"help", "Print the help of the program or of a verb",
            "The same as 'stgs --help' and 'stgs VERB --help'.", "  stgs help\n  stgs help render"};
  }
  Shared shared() const override { return {}; }
  void declare(Arguments& app) override {
    app_ = &app.app();
    app.add_option("VERB", verb_, "The verb");
  }
  Status run(Session& session) override {
    const CLI::App& program = *app_->get_parent();
    const CLI::App* topic = verb_.empty() ? &program : nullptr;
    std::vector<std::string> names;
    for (const CLI::App* verb : program.get_subcommands([](const CLI::App*) { return true; })) {
      names.push_back(verb->get_name());
      if (verb->get_name() == verb_) topic = verb;
    }
    if (topic == nullptr) return usage_error("{}", unknown_verb_message(verb_, names));
    // Not topic->help(): that of the program prints the help of the parsed verb.
    const std::string name = verb_.empty() ? "stgs" : "stgs " + verb_;
    const std::string text =
        topic->get_formatter()->make_help(topic, name, CLI::AppFormatMode::Normal);
    return session.emit({{"verb", verb_.empty() ? Json(nullptr) : Json(verb_)}, {"text", text}},
                        text);
  }

 private:
  const CLI::App* app_ = nullptr;
  std::string verb_;
};

}  // namespace

std::unique_ptr<Command> make_help() {
  return std::make_unique<ShowHelp>();
}

}  // namespace stgs::tools
