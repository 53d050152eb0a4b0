// SPDX-License-Identifier: Apache-2.0
// Checkpoints: the complete TrainState and the fingerprint of its run. Training resumed from a
// checkpoint is bit-identical to training that was never interrupted.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/encoder/persistent_set.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/status.h"
#include "train/fingerprint.h"
#include "train/train_state.h"

namespace stgs::encoder {

struct Checkpoint {
  TrainState state;
  Fingerprint fingerprint;  // of the run that wrote it
  // Of a persistent set, see there.
  RecordedSet recorded;
  std::vector<std::vector<std::uint8_t>> residuals;
};

// Writes to a temporary name, then renames. kIo on failure.
Status write_checkpoint(const std::string& path, const TrainState& state,
                        const Fingerprint& fingerprint, const RecordedSet& recorded = {},
                        const std::vector<std::vector<std::uint8_t>>& residuals = {});

// Reads a checkpoint. kInvalidFile if it is damaged, kUnsupported if it has the layout of another
// version. check_same_run() checks that it belongs to the run.
Result<Checkpoint> read_checkpoint(const std::string& path);

// Checks that a state has the arrays of a run. check_same_run() compares only the fields of the
// checkpoint. `coupled`: TrainState::is_coupled() of the run. kInvalidFile if it
// does not. `path` is the checkpoint's, for the message.
Status check_state(const std::string& path, const TrainState& state, const PreparedCapture& capture,
                   int sh_degree, bool coupled, bool refined);

// Returns a hash of all state that a checkpoint stores.
std::uint64_t state_hash(const TrainState& state);

}  // namespace stgs::encoder
