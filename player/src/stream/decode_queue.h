// SPDX-License-Identifier: Apache-2.0
// Decides which segment to decode next.
#pragma once

#include <optional>

#include "stgs/format/budget.h"
#include "stream/deadlines.h"
#include "stream/decode_executor.h"
#include "stream/residency.h"
#include "stream/segment_index.h"
#include "stream/urgency_tree.h"

namespace stgs::player {

// Creates decode jobs by deadline, as many as the executor and Budget::Pool::kDecodeScratch allow,
// but at least one. Not thread-safe.
class DecodeQueue {
 public:
  // Everything given by reference outlives this object. Call reserve() when the index grows.
  DecodeQueue(const SegmentIndex& index, const Deadlines& deadlines, Residency& residency,
              Budget& budget, const DecodeExecutor& executor)
      : index_(index),
        deadlines_(deadlines),
        residency_(residency),
        budget_(budget),
        executor_(executor) {
    reserve(index.size());
  }

  // Reserves memory, so that next() of so many segments does not throw.
  void reserve(std::size_t segments);
  // Returns the next job, which is in flight until finish(); nothing if there is none or it has to
  // wait.
  std::optional<DecodeJob> next() noexcept;
  // Ends a job. Returns false if its result is of an earlier generation, and is to be discarded.
  bool finish(const DecodeJob& job) noexcept;

  // Returns the number of segments examined so far to find the most urgent ones.
  std::uint64_t examined_segments() const { return examined_; }

 private:
  void update() noexcept;
  void examine(std::uint32_t segment) noexcept;
  std::optional<std::uint32_t> next_segment() noexcept;

  const SegmentIndex& index_;
  const Deadlines& deadlines_;
  Residency& residency_;
  Budget& budget_;
  const DecodeExecutor& executor_;
  int in_flight_ = 0;
  int ahead_ = 0;  // of these, segments that were not needed yet

  // The decodable segments, by number: those that are needed now, and the others.
  UrgencyTree needed_, later_;
  // What the trees are made for.
  bool is_built_ = false;
  Playhead playhead_;
  std::uint64_t revision_ = 0;       // SegmentIndex::revision()
  std::uint64_t changes_until_ = 0;  // in Residency::decode_changes()
  std::uint64_t examined_ = 0;
};

}  // namespace stgs::player
