// SPDX-License-Identifier: Apache-2.0
// Weighing what was trained, where it was trained.
#pragma once

#include "backend/backend.h"

namespace stgs::encoder {

// The importances of the state's primitives by the backend, where that fails by `spare`, and where
// that fails too none, which pack makes up for by sizes: each with a warning, as nothing that was
// trained may be lost to it. Nothing where `go_on` answers false; what that throws goes on. After
// the last step.
std::optional<std::vector<float>> compute_importance(TrainBackend& backend, TrainBackend& spare,
                                                     TrainState& state,
                                                     std::span<const ImportanceView> views,
                                                     const std::function<bool(double)>& go_on,
                                                     const LogSink& log);

}  // namespace stgs::encoder
