// SPDX-License-Identifier: Apache-2.0
#include "command.h"
#include "version.h"

namespace stgs::tools {
namespace {

class Version final : public Command {
 public:
  Help help() const override {
    return {
        "version", "Print the version and the built-in features",
        "Prints the versions of the program and of the format, the vector target, the backends,\n"
        "and the optional features of this build. The same as 'stgs --version'.",
        "  stgs version\n  stgs version --format json"};
  }
  Shared shared() const override { return {}; }
  void declare(Arguments& /*app*/) override {}
  Status run(Session& session) override {
    return session.emit(version_json(), version_text() + "\n");
  }
};

}  // namespace

std::unique_ptr<Command> make_version() {
  return std::make_unique<Version>();
}

}  // namespace stgs::tools
