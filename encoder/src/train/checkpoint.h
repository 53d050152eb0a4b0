// SPDX-License-Identifier: Apache-2.0
// Checkpoints: the whole TrainState and a fingerprint of what it belongs to. Training that goes on
// from one is bit-identical to training that was never interrupted.
#pragma once

#include <string>

#include "stgs/format/status.h"
#include "train/train_state.h"

namespace stgs::encoder {

// Written to a temporary name and renamed. `fingerprint` names everything that the continuation
// depends on: settings, seed, capture.
Status write_checkpoint(const std::string& path, const TrainState& state,
                        const std::string& fingerprint);

// Refuses damage (kInvalidFile) and a checkpoint of other settings (kUsage).
Result<TrainState> read_checkpoint(const std::string& path, const std::string& fingerprint);

}  // namespace stgs::encoder
