// SPDX-License-Identifier: Apache-2.0
#include "train/weigh.h"

#include <fmt/format.h>

#include <exception>

namespace stgs::encoder {
namespace {

using Weighed = Result<std::optional<std::vector<float>>>;

// A view whose tiles cannot be listed, and what finds no memory, are thrown by the CPU's.
Weighed caught(const std::function<Weighed()>& weigh) {
  try {
    return weigh();
  } catch (const std::exception& error) {
    return Status(code_of(error), error.what());
  }
}

}  // namespace

std::optional<std::vector<float>> weigh_primitives(TrainBackend& backend, TrainState& state,
                                                   std::span<const ImportanceView> views,
                                                   const std::function<bool(double)>& go_on,
                                                   const LogSink& log) {
  Weighed weighed = caught([&]() -> Weighed {
    // Without what was left out as broken.
    STGS_TRY(backend.begin(state));
    return backend.importance(views, go_on);
  });
  if (!weighed.ok()) {
    log(1, fmt::format("the primitives are weighed on the CPU: {}", weighed.status().message()));
    weighed = caught([&]() -> Weighed { return view_importance(state.set, views, go_on); });
  }
  if (weighed.ok()) return *std::move(weighed);
  log(1, fmt::format("the primitives are not weighed, so that pack goes by their sizes: {}",
                     weighed.status().message()));
  return std::vector<float>();
}

}  // namespace stgs::encoder
