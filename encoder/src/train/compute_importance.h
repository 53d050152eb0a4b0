// SPDX-License-Identifier: Apache-2.0
// Computes the importances of trained primitives on the training backend, with a fallback.
#pragma once

#include "backend/backend.h"

namespace stgs::encoder {

// Computes the importances of the state's primitives with `backend`, or with `fallback` if that
// fails. If both fail, returns an empty vector, and pack uses the primitives' sizes instead. Each
// failure is logged as a warning, because no trained scene may be lost to it. Returns nullopt if
// `should_continue` returns false; rethrows its exceptions. Call after the last step.
std::optional<std::vector<float>> compute_importance(
    TrainBackend& backend, TrainBackend& fallback, TrainState& state,
    std::span<const ImportanceView> views, const std::function<bool(double)>& should_continue,
    const LogSink& log);

}  // namespace stgs::encoder
