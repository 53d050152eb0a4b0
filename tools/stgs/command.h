// SPDX-License-Identifier: Apache-2.0
// A verb of the program. The shared options, results and progress are the session's.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "session.h"
#include "stgs/format/status.h"

namespace CLI {
class App;
}

namespace stgs::tools {

// What a verb's --help says beside its options.
struct Help {
  const char* name;
  const char* summary;  // one line for the list of verbs
  const char* text;     // two or three lines: what it does, what comes out
  const char* example;  // command lines that work
};

// The shared options that do something for a verb, beside --format, which every verb takes.
struct Shared {
  bool progress = false, log_level = false;
  const char* backend = nullptr;  // what --backend chooses, for its help; null: not taken
  bool trains = false;            // it: not every one that draws
  bool threads = false, seed = false;
};

class Command {
 public:
  virtual ~Command() = default;
  virtual Help help() const = 0;
  virtual Shared shared() const = 0;
  // Declares the verb's own options; they are filled by parsing.
  virtual void declare(CLI::App& app) = 0;
  // Does the work after parsing.
  virtual Status run(Session& session) = 0;
};

std::unique_ptr<Command> make_bench();
std::unique_ptr<Command> make_compare();
std::unique_ptr<Command> make_convert();
std::unique_ptr<Command> make_encode();
std::unique_ptr<Command> make_evaluate();
std::unique_ptr<Command> make_finalize();
std::unique_ptr<Command> make_info();
std::unique_ptr<Command> make_pack();
std::unique_ptr<Command> make_play();
std::unique_ptr<Command> make_prepare();
std::unique_ptr<Command> make_render();
std::unique_ptr<Command> make_train();
std::unique_ptr<Command> make_validate();

// Every verb, in the order of the road.
std::vector<std::unique_ptr<Command>> all_commands();

}  // namespace stgs::tools
