// SPDX-License-Identifier: Apache-2.0
#include "program.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <iostream>

#include "command.h"
#include "config_file.h"
#include "error_report.h"
#include "opencv.h"
#include "options.h"
#include "stgs/player/source.h"
#include "usage.h"
#include "version.h"

namespace stgs::tools {
namespace {

constexpr const char* kExitCodes =
    "Exit codes: 0 ok, 1 usage, 2 input or output, 3 invalid file, 4 failed or interrupted,\n"
    "            5 unsupported here, 6 not built in, 7 differs.";

struct Verb {
  std::unique_ptr<Command> command;
  CLI::App* app = nullptr;
  std::unique_ptr<Arguments> arguments;
};

void declare_shared(CLI::App& app, const Shared& shared, CommonOptions& options) {
  const char* group = "Common options";
  // Only documents the option: with_config_first() moves it before the verb.
  app.add_option("--config", options.config,
                 "Read options from a TOML file, from its section [VERB]; the command line wins")
      ->group(group);
  with_choices(app.add_option("--format", options.format, "Output format: text or json"),
               {"text", "json"})
      ->capture_default_str()
      ->group(group);
  if (shared.progress) {
    with_choices(
        app.add_option(
            "--progress", options.progress,
            "Progress on standard error: auto (a bar on a terminal), bar, json (one object per "
            "line) or none"),
        {"auto", "bar", "json", "none"})
        ->capture_default_str()
        ->group(group);
  }
  if (shared.log_level) {
    with_choices(app.add_option("--log-level", options.log_level,
                                "Messages to print: error, warning, info or debug"),
                 {"error", "warning", "info", "debug"})
        ->capture_default_str()
        ->group(group);
  }
  if (shared.backend != nullptr) {
    std::vector<std::string> backends = {"auto", "cpu", "cuda"};
    if (!shared.trains) backends.push_back("vulkan");
    with_choices(app.add_option("--backend", options.backend,
                                fmt::format("{}: auto, cpu{}", shared.backend,
                                            shared.trains ? " or cuda" : ", cuda or vulkan")),
                 backends)
        ->capture_default_str()
        ->group(group);
  }
  if (shared.threads) {
    app.add_option("--threads", options.threads,
                   "Maximum number of threads; 0: all cores. Does not change results")
        ->check(number_between(0, 4096))
        ->capture_default_str()
        ->group(group);
  }
  if (shared.urls) {
    app.add_option("--timeout", options.timeout,
                   "URLs: limit of a read with all its attempts, seconds; longer by 1 ms for each "
                   "byte that arrives")
        ->check(number_between(player::kMinRequestSeconds, player::kMaxRequestSeconds))
        ->capture_default_str()
        ->group(group);
    app.add_flag("--allow-private", options.allow_private,
                 "URLs: public host names and redirections may lead to private networks")
        ->group(group);
  }
  if (shared.seed) {
    app.add_option("--seed", options.seed, "Seed of the random choices")
        ->check(check_integer)
        ->capture_default_str()
        ->group(group);
  }
}

std::vector<Verb> declare_verbs(CLI::App& app, CommonOptions& options) {
  std::vector<Verb> verbs;
  for (auto& command : all_commands()) {
    const Help help = command->help();
    CLI::App* verb = app.add_subcommand(help.name, help.summary);
    verb->footer(fmt::format("{}\n\nExample:\n{}\n\n{}", help.text, help.example, kExitCodes));
    auto arguments = std::make_unique<Arguments>(*verb);
    command->declare(*arguments);
    declare_shared(*verb, command->shared(), options);
    verbs.push_back({std::move(command), verb, std::move(arguments)});
  }
  return verbs;
}

// Reports an error of the command line, before its options are known.
int usage(Session& session, const std::string& message) {
  if (wants_json(session.arguments)) session.options.format = "json";
  return session.conclude(usage_error("{}", message));
}

// Returns the command line, with arguments quoted for a shell.
std::string command_line(int argc, char** argv) {
  std::string line = "stgs";
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    std::string quoted;
    for (const char c : argument) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
    const bool plain =
        !argument.empty() &&
        argument.find_first_not_of(
            "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=:,./@%") ==
            std::string::npos;
    line += plain ? " " + argument : " '" + quoted + "'";
  }
  return line;
}

// Returns the arguments in reverse, as CLI11 expects them, with --config FILE before the verb,
// where CLI11 accepts it.
std::vector<std::string> with_config_first(int argc, char** argv) {
  std::vector<std::string> config, others;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--config" && i + 1 < argc) {
      config.push_back(argument);
      config.emplace_back(argv[++i]);
    } else {
      (argument.rfind("--config=", 0) == 0 ? config : others).push_back(argument);
    }
  }
  config.insert(config.end(), others.begin(), others.end());
  std::reverse(config.begin(), config.end());
  return config;
}

int run_verb(const Verb& verb, Session& session) {
  install_signal_handlers();
  set_up_opencv(session.options);
  Status status = session.start();
  if (status.ok()) status = verb.command->run(session);
  const bool has_memory_option = verb.app->get_option_no_throw("--memory") != nullptr;
  return session.conclude(has_memory_option ? with_memory_option(status) : status);
}

}  // namespace

int run_program(int argc, char** argv) {
  CLI::App app(
      "STGS turns synchronised multi-view video into one .stgs file of 4D Gaussians and plays it\n"
      "from any viewpoint.",
      "stgs");
  app.footer(
      fmt::format("Run 'stgs VERB --help' for the options of a verb.\n\nExample:\n"
                  "  stgs encode CAPTURE -o scene.stgs\n"
                  "  stgs render scene.stgs --time 0.5 -o image.png\n\n{}",
                  kExitCodes));
  app.set_config("--config")->group("")->check(check_config_file, "");  // the verbs document it
  app.config_formatter(std::make_shared<ConfigFile>());
  app.allow_config_extras(CLI::config_extras_mode::error);
  app.set_version_flag("--version", version_text, "Print the version and the built-in features");
  app.require_subcommand(0, 1);
  Session session;
  session.command = command_line(argc, argv);
  session.arguments.assign(argv + 1, argv + argc);
  const std::vector<Verb> verbs = declare_verbs(app, session.options);
  const std::string first = argc > 1 ? argv[1] : "";
  std::vector<std::string> names;
  names.reserve(verbs.size());
  for (const Verb& verb : verbs) names.push_back(verb.app->get_name());
  const bool known = std::find(names.begin(), names.end(), first) != names.end();
  if (!first.empty() && first[0] != '-' && !known)
    return usage(session, unknown_verb_message(first, names));
  try {
    app.parse(with_config_first(argc, argv));
  } catch (const CLI::Success& success) {
    app.exit(success);  // --help, --version: prints to standard output
    std::cout.flush();
    if (std::cout.good() && std::fflush(stdout) == 0) return 0;
    session.report_error(io_error("standard output: cannot write"));
    return static_cast<int>(StatusCode::kIo);
  } catch (const CLI::ParseError& error) {
    return usage(session, usage_message(app, error));
  }
  for (const Verb& verb : verbs) {
    if (!verb.app->parsed()) continue;
    const std::string empty = empty_value_message(*verb.app);
    return empty.empty() ? run_verb(verb, session) : usage(session, empty);
  }
  fmt::print(stderr, "{}", app.help());
  return usage(session, "no verb is given");
}

}  // namespace stgs::tools
