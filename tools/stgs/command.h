// SPDX-License-Identifier: Apache-2.0
// The interface of a verb. Common options, results and progress belong to Session.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "arguments.h"
#include "session.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// The text of a verb's --help, apart from its options.
struct Help {
  const char* name;
  const char* summary;  // one line for the list of verbs
  const char* text;     // a paragraph: purpose, results and conditions
  const char* example;  // command lines that work, indented by two spaces
};

// The common options that a verb accepts. Every verb also accepts --format.
struct Shared {
  bool progress = false, log_level = false;
  const char* backend = nullptr;  // label of --backend in the help; null: no --backend
  bool trains = false;            // --backend accepts the training backends only
  bool threads = false, seed = false;
  bool urls = false;  // the verb reads URLs: --timeout and --allow-private
};

class Command {
 public:
  virtual ~Command() = default;
  virtual Help help() const = 0;
  virtual Shared shared() const = 0;
  // Declares the verb's own options. Parsing fills them in.
  virtual void declare(Arguments& app) = 0;
  // Runs the verb. Called once, after parsing.
  virtual Status run(Session& session) = 0;
};

std::unique_ptr<Command> make_bench();
std::unique_ptr<Command> make_compare();
std::unique_ptr<Command> make_convert();
std::unique_ptr<Command> make_encode();
std::unique_ptr<Command> make_evaluate();
std::unique_ptr<Command> make_finalize();
std::unique_ptr<Command> make_help();
std::unique_ptr<Command> make_info();
std::unique_ptr<Command> make_live();
std::unique_ptr<Command> make_pack();
std::unique_ptr<Command> make_play();
std::unique_ptr<Command> make_prepare();
std::unique_ptr<Command> make_render();
std::unique_ptr<Command> make_serve();
std::unique_ptr<Command> make_train();
std::unique_ptr<Command> make_validate();
std::unique_ptr<Command> make_version();
std::unique_ptr<Command> make_web();

// Returns every verb, in the order of the workflow from capture to playback.
std::vector<std::unique_ptr<Command>> all_commands();

}  // namespace stgs::tools
