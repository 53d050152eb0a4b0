// SPDX-License-Identifier: Apache-2.0
// Keeps the ranks of a training in lockstep: between steps they agree on the clock and on whether
// to stop, and verify that their states are identical. Without ranks, nothing blocks and the values
// of the single process apply.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/encoder/ranks.h"

namespace stgs::encoder {

class Lockstep {
 public:
  // `ranks` is not owned; null: this process trains alone.
  explicit Lockstep(Ranks* ranks) : ranks_(ranks) {}

  Ranks* ranks() const { return ranks_; }
  int size() const { return ranks_ == nullptr ? 1 : ranks_->size(); }
  int rank() const { return ranks_ == nullptr ? 0 : ranks_->rank(); }
  int node_size() const { return ranks_ == nullptr ? 1 : ranks_->node_size(); }
  // Returns whether this is rank 0, which writes files, logs and progress.
  bool is_first() const { return rank() == 0; }

  struct ClockState {
    double seconds = 0;            // of training so far
    bool is_progress_due = false;  // progress is to be reported
  };
  // Returns rank 0's clock on every rank.
  Result<ClockState> sync_clock(const ClockState& own);
  // Returns whether `own` is true on any rank.
  Result<bool> any(bool own);
  // Returns kUsage, which names `subject`, if a rank's text differs from rank 0's.
  Status check_same_text(const std::string& own, const std::string& subject);
  // Returns kRuntime if a rank's state hash differs from rank 0's.
  Status check_same_state(std::uint64_t hash);

 private:
  // Returns the first rank whose value differs from rank 0's; 0: none.
  Result<int> first_mismatch(std::uint64_t own);

  Ranks* ranks_;
};

}  // namespace stgs::encoder
