// SPDX-License-Identifier: Apache-2.0
// The end of a run in the middle of work that cannot be interrupted, as decoding or rendering an
// image of any size.
#pragma once

#include <string>
#include <thread>

#include "session.h"

namespace stgs::tools {

// While it exists, the program ends 0.8 s after SIGINT or SIGTERM, as after kRuntime with
// `message`, whatever the verb does then. Outputs stay as they were, and temporary files are
// removed. Claim outputs before. Several may exist.
class EndAfterSignal {
 public:
  EndAfterSignal(Session& session, std::string message);

 private:
  std::jthread watcher_;
};

// Has the ends above also call `remove`, for the temporary files of a module, which has a list of
// its own (remove_unfinished()). One module at most.
void end_of_module(void (*remove)() noexcept);

}  // namespace stgs::tools
