// SPDX-License-Identifier: Apache-2.0
// The order in which missing layers are fetched.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "stream/deadlines.h"
#include "stream/residency.h"
#include "stream/segment_index.h"
#include "stream/urgency_tree.h"

namespace stgs::player {

// Finds the most urgent layer that can be fetched. A new playback position or reader takes
// O(n log n) for n layers that are needed soon, each change of a layer's state O(log n). Times are
// seconds of a monotonic clock. Not thread-safe.
class FetchPlan {
 public:
  // Everything given by reference outlives this object. `prefetch_seconds`: layers needed later
  // than this are not fetched yet.
  FetchPlan(const SegmentIndex& index, const Deadlines& deadlines, const Residency& residency,
            double prefetch_seconds)
      : index_(index),
        deadlines_(deadlines),
        residency_(residency),
        prefetch_seconds_(prefetch_seconds) {}

  // Adopts the present state of all layers. There is a playback position. If this throws, the next
  // call starts again.
  void update(double now);
  // Returns the most urgent layer that arrives in time at `speed`, bytes per second; infinity: in
  // any time. As of the last update().
  std::optional<SegmentLayer> first(double speed) const;
  // Returns when a failed layer can be fetched again; infinity: never. As of the last update().
  double retry_at() const { return retries_.empty() ? kNever : retries_.front().first; }

  // Returns whether a layer is missing and needed within the prefetch horizon, or was so when it
  // failed and is to be retried.
  bool is_fetchable(const SegmentLayer& layer, double now) const;
  // Returns the throughput at which a layer arrives just before the last time that shows it, bytes
  // per second. Layer 0 is always attempted: 0.
  double min_speed(const SegmentLayer& layer) const;

  // Returns the number of layers examined so far.
  std::uint64_t examined() const { return examined_; }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();
  static constexpr std::uint32_t kNoSlot = std::numeric_limits<std::uint32_t>::max();
  struct Slot {
    std::size_t file_index = 0;
    double min_speed = 0, deadline = 0;
  };
  using Retry = std::pair<double, std::uint32_t>;  // time, slot

  bool is_current() const;
  void rebuild(double now);
  void add_slot(std::size_t file_index);
  void examine(std::uint32_t slot, double now);
  double current_deadline(std::uint32_t slot, double now);
  void examine_retries(double now);
  void note_retry(std::uint32_t slot, double now);
  const SegmentLayer& layer_of(std::uint32_t slot) const {
    return index_.file_order()[slots_[slot].file_index];
  }

  const SegmentIndex& index_;
  const Deadlines& deadlines_;
  const Residency& residency_;
  const double prefetch_seconds_;

  // What the following members are made for.
  bool is_built_ = false;
  Playhead playhead_;
  std::uint64_t revision_ = 0;       // SegmentIndex::revision()
  std::uint64_t changes_until_ = 0;  // in Residency::changes()

  std::vector<Slot> slots_;             // layers within the prefetch horizon, by min_speed
  std::vector<std::uint32_t> slot_of_;  // by index in the file order; or kNoSlot
  UrgencyTree tree_;                    // of the slots that can be fetched
  std::vector<Retry> retries_;          // a heap, earliest first; may contain outdated ones
  std::uint64_t examined_ = 0;
};

}  // namespace stgs::player
