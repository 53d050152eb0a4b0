// SPDX-License-Identifier: Apache-2.0
// Decides which segment to decode next.
#pragma once

#include <optional>

#include "stgs/format/budget.h"
#include "stream/deadlines.h"
#include "stream/decode_executor.h"
#include "stream/residency.h"
#include "stream/segment_index.h"

namespace stgs::player {

// Creates decode jobs by deadline, as many as the executor and Budget::Pool::kDecodeScratch allow,
// but at least one. Not thread-safe.
class DecodeQueue {
 public:
  // Everything given by reference outlives this object.
  DecodeQueue(const SegmentIndex& index, const Deadlines& deadlines, Residency& residency,
              Budget& budget, const DecodeExecutor& executor)
      : index_(index),
        deadlines_(deadlines),
        residency_(residency),
        budget_(budget),
        executor_(executor) {}

  // Returns the next job, which is in flight until finish(); nothing if there is none or it has to
  // wait.
  std::optional<DecodeJob> next() noexcept;
  // Ends a job. Returns false if its result is of an earlier generation, and is to be discarded.
  bool finish(const DecodeJob& job) noexcept;

 private:
  std::optional<std::uint32_t> next_segment() const;

  const SegmentIndex& index_;
  const Deadlines& deadlines_;
  Residency& residency_;
  Budget& budget_;
  const DecodeExecutor& executor_;
  int in_flight_ = 0;
  int ahead_ = 0;  // of these, segments that were not needed yet
};

}  // namespace stgs::player
