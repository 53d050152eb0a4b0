// SPDX-License-Identifier: Apache-2.0
#include "end_after_signal.h"

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <utility>

#include "stgs/format/temporary.h"

namespace stgs::tools {
namespace {

std::atomic<void (*)() noexcept> module_remove = nullptr;

}  // namespace

void end_of_module(void (*remove)() noexcept) {
  module_remove = remove;
}

EndAfterSignal::EndAfterSignal(Session& session, std::string message)
    : watcher_([&session, message = std::move(message)](const std::stop_token& done) {
        constexpr std::chrono::milliseconds kPoll(50);
        constexpr int kPolls = 16;  // after the signal
        for (int polls = 0; polls < kPolls; polls += interrupted() ? 1 : 0) {
          std::this_thread::sleep_for(kPoll);
          if (done.stop_requested()) return;
        }
        static std::atomic<bool> ending = false;  // by another object
        if (ending.exchange(true)) return;
        const int code = session.conclude(runtime_error("{}", message));
        remove_unfinished();
        if (auto* const remove = module_remove.load()) remove();
        std::_Exit(code);
      }) {}

}  // namespace stgs::tools
