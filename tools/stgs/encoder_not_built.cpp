// SPDX-License-Identifier: Apache-2.0
// The verbs of the encoder in a build without it: each accepts any arguments and answers kNotBuilt.
#include "command.h"

namespace stgs::tools {
namespace {

class NotBuilt final : public Command {
 public:
  NotBuilt(const char* name, const char* summary) : name_(name), summary_(summary) {}

  Help help() const override {
    return {name_, summary_,
            "Not part of this build, which plays scenes and has no encoder. Build with\n"
            "-DSTGS_WITH_ENCODER=ON.",
            "  stgs --version"};
  }
  Shared shared() const override { return {}; }
  void declare(Arguments& app) override { app.allow_extras(); }
  Status run(Session&) override {
    return not_built("'{}' is not part of this build; build with -DSTGS_WITH_ENCODER=ON", name_);
  }

 private:
  const char* name_;
  const char* summary_;
};

}  // namespace

std::unique_ptr<Command> make_prepare() {
  return std::make_unique<NotBuilt>("prepare", "Make a prepared capture (not in this build)");
}

std::unique_ptr<Command> make_train() {
  return std::make_unique<NotBuilt>("train", "Train a scene (not in this build)");
}

std::unique_ptr<Command> make_pack() {
  return std::make_unique<NotBuilt>("pack", "Compress a scene (not in this build)");
}

std::unique_ptr<Command> make_encode() {
  return std::make_unique<NotBuilt>("encode", "Prepare, train and pack (not in this build)");
}

std::unique_ptr<Command> make_live() {
  return std::make_unique<NotBuilt>("live", "Encode a rig while it films (not in this build)");
}

}  // namespace stgs::tools
