// SPDX-License-Identifier: Apache-2.0
// What the ranks of a training agree on between steps, so that all decide alike: the clock, whether
// to stop, and that their states are still the same. Alone (no ranks) nothing waits and everything
// is as the one process says.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/encoder/ranks.h"

namespace stgs::encoder {

class Lockstep {
 public:
  // Not owned; null: alone.
  explicit Lockstep(Ranks* ranks) : ranks_(ranks) {}

  Ranks* ranks() const { return ranks_; }
  int size() const { return ranks_ == nullptr ? 1 : ranks_->size(); }
  int rank() const { return ranks_ == nullptr ? 0 : ranks_->rank(); }
  int node_size() const { return ranks_ == nullptr ? 1 : ranks_->node_size(); }
  // The rank that writes files, logs and progress.
  bool first() const { return rank() == 0; }

  struct Moment {
    double seconds = 0;     // of training so far
    bool progress = false;  // is due
  };
  // The first rank's.
  Result<Moment> moment(const Moment& own);
  // Whether it is so on any rank.
  Result<bool> any(bool own);
  // kUsage, naming `what`, where a rank has another text than the first; kRuntime for a state.
  Status same_text(const std::string& own, const std::string& what);
  Status same_state(std::uint64_t hash);

 private:
  // The first rank that gave something else than rank 0; 0: none.
  Result<int> first_other(std::uint64_t own);

  Ranks* ranks_;
};

}  // namespace stgs::encoder
