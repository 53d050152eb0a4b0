// SPDX-License-Identifier: Apache-2.0
#include "train/compute_importance.h"

#include <fmt/format.h>

#include <exception>

namespace stgs::encoder {
namespace {

using ShouldContinue = std::function<bool(double)>;
using Importance = Result<std::optional<std::vector<float>>>;

// Converts exceptions to a status: the CPU backend throws if a view has too many tile instances or
// memory runs out.
Importance run_backend(TrainBackend& backend, TrainState& state,
                       std::span<const ImportanceView> views,
                       const ShouldContinue& should_continue) {
  try {
    STGS_TRY(backend.begin(state));  // without the non-finite primitives, which were removed
    return backend.importance(views, should_continue);
  } catch (const std::exception& error) {
    return Status(code_of(error), error.what());
  }
}

}  // namespace

std::optional<std::vector<float>> compute_importance(TrainBackend& backend, TrainBackend& fallback,
                                                     TrainState& state,
                                                     std::span<const ImportanceView> views,
                                                     const ShouldContinue& should_continue,
                                                     const LogSink& log) {
  std::exception_ptr thrown;
  const ShouldContinue guarded = [&](double done) {
    try {
      return should_continue(done);
    } catch (...) {
      thrown = std::current_exception();
      return false;
    }
  };
  Importance importance = run_backend(backend, state, views, guarded);
  if (!importance.ok()) {
    log(1,
        fmt::format("importances could not be computed on the training backend ({}); using the CPU",
                    importance.status().message()));
    importance = run_backend(fallback, state, views, guarded);
  }
  if (thrown) std::rethrow_exception(thrown);
  if (importance.ok()) return *std::move(importance);
  log(1, fmt::format(
             "importances could not be computed ({}); pack will use the sizes of the primitives",
             importance.status().message()));
  return std::vector<float>();
}

}  // namespace stgs::encoder
