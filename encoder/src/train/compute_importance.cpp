// SPDX-License-Identifier: Apache-2.0
#include "train/compute_importance.h"

#include <fmt/format.h>

#include <exception>

namespace stgs::encoder {
namespace {

using GoOn = std::function<bool(double)>;
using Weighed = Result<std::optional<std::vector<float>>>;

// A view whose tiles cannot be listed, and what finds no memory, are thrown by the CPU's.
Weighed weigh(TrainBackend& backend, TrainState& state, std::span<const ImportanceView> views,
              const GoOn& go_on) {
  try {
    STGS_TRY(backend.begin(state));  // without what was left out as broken
    return backend.importance(views, go_on);
  } catch (const std::exception& error) {
    return Status(code_of(error), error.what());
  }
}

}  // namespace

std::optional<std::vector<float>> compute_importance(TrainBackend& backend, TrainBackend& spare,
                                                     TrainState& state,
                                                     std::span<const ImportanceView> views,
                                                     const GoOn& go_on, const LogSink& log) {
  std::exception_ptr thrown;
  const GoOn asked = [&](double done) {
    try {
      return go_on(done);
    } catch (...) {
      thrown = std::current_exception();
      return false;
    }
  };
  Weighed weighed = weigh(backend, state, views, asked);
  if (!weighed.ok()) {
    log(1, fmt::format("the primitives are weighed once more, on the CPU: {}",
                       weighed.status().message()));
    weighed = weigh(spare, state, views, asked);
  }
  if (thrown) std::rethrow_exception(thrown);
  if (weighed.ok()) return *std::move(weighed);
  log(1, fmt::format("the primitives are not weighed, so that pack goes by their sizes: {}",
                     weighed.status().message()));
  return std::vector<float>();
}

}  // namespace stgs::encoder
