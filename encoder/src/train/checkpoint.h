// SPDX-License-Identifier: Apache-2.0
// Checkpoints: the whole TrainState and a fingerprint of what it belongs to. Training that goes on
// from one is bit-identical to training that was never interrupted.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/format/status.h"
#include "train/fingerprint.h"
#include "train/train_state.h"

namespace stgs::encoder {

struct Checkpoint {
  TrainState state;
  Fingerprint fingerprint;  // of the run that wrote it
};

// Written to a temporary name and renamed.
Status write_checkpoint(const std::string& path, const TrainState& state,
                        const Fingerprint& fingerprint);

// Refuses damage (kInvalidFile) and the layout of another version (kUnsupported). Whether it
// belongs to the run, check_same_run says.
Result<Checkpoint> read_checkpoint(const std::string& path);

// Of all that a checkpoint holds of the state.
std::uint64_t state_hash(const TrainState& state);

}  // namespace stgs::encoder
