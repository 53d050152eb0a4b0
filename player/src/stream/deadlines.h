// SPDX-License-Identifier: Apache-2.0
// When each segment layer is needed, given the playback position.
#pragma once

#include <cstdint>
#include <limits>

#include "stream/need.h"
#include "stream/segment_index.h"

namespace stgs::player {

// Not thread-safe. The index outlives this object.
class Deadlines {
 public:
  // `layer_lead_seconds`: how much further ahead each layer of the file is needed than the next.
  Deadlines(const SegmentIndex& index, double layer_lead_seconds)
      : index_(index), lead_(layer_lead_seconds) {}

  // Sets the playback position. `jumped`: it did not result from playback.
  void set_playhead(const Playhead& playhead, bool jumped) {
    has_playhead_ = true;
    playhead_ = playhead;
    jumps_ += jumped ? 1 : 0;
  }
  // Sets the duration that applies until the first set_playhead(), ticks.
  void set_duration(double ticks) { playhead_.duration = ticks; }
  bool has_playhead() const { return has_playhead_; }
  const Playhead& playhead() const { return playhead_; }
  // Returns the number of jumps so far.
  std::uint64_t jumps() const { return jumps_; }
  double layer_lead_seconds() const { return lead_; }

  // Returns when a segment is needed next.
  Need need(std::uint32_t segment) const {
    if (!index_.is_needed(segment)) return {kNever, kNever};
    const SegmentInfo& info = index_.info(segment);
    return need_of(info.begin_ticks, info.end_ticks, playhead_);
  }
  // Returns the deadline of a layer, seconds from now.
  double deadline(const SegmentLayer& layer) const {
    return player::deadline(need(layer.segment), index_.layer_number(layer), lead_);
  }
  // Returns whether a segment is not needed at the playback position yet.
  bool is_ahead(std::uint32_t segment) const { return need(segment).from > 0; }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  const SegmentIndex& index_;
  const double lead_;
  bool has_playhead_ = false;
  Playhead playhead_;
  std::uint64_t jumps_ = 0;
};

}  // namespace stgs::player
