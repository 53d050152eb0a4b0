// SPDX-License-Identifier: Apache-2.0
// The persistent content of a long capture: static primitives that are trained in the window of
// time that first shows them, stored once, and displayed from then on. Later windows render them
// unchanged. Primitives that no longer match the images end: the set then lacks them.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "stgs/format/scene_recorder.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct TrainState;

// A member of a persistent set that a window ends: its index among the stored primitives, and the
// frame of the window from which on it is not displayed.
struct MemberEnd {
  std::uint32_t member = 0, frame = 0;
  bool operator==(const MemberEnd&) const = default;
};

// The part of a persistent set that a recording holds.
struct RecordedSet {
  // Where the stored primitives are, in the order of the state.
  std::vector<StoredPrimitive> primitives;
  std::uint64_t bytes = 0;  // length of the recording up to the end of the window
};

// The result of a window that the next one starts from. Copies share the state, which does not
// change. One thread at a time.
class PersistentSet {
 public:
  // An empty set, for the first window. `carries_moving`: each window also starts from the moving
  // content at the end of the previous one. It helps if few frames of a window have dynamic points;
  // otherwise these are better.
  explicit PersistentSet(bool carries_moving = false) : carries_moving_(carries_moving) {}
  // `state`: see persistent_state() (train/persistence.h). `residuals`: see below. `ends`: the
  // members of the set before that this window has ended. The others, in their order, and then
  // those that the window added are the members of this set.
  PersistentSet(std::shared_ptr<const TrainState> state, bool carries_moving,
                RecordedSet recorded = {}, std::vector<std::vector<std::uint8_t>> residuals = {},
                std::vector<MemberEnd> ends = {})
      : state_(std::move(state)),
        carries_moving_(carries_moving),
        recorded_(std::move(recorded)),
        residuals_(std::move(residuals)),
        ends_(std::move(ends)) {}

  // Reads a set that does not carry moving content. kIo, or kInvalidFile for a damaged or another
  // file.
  static Result<PersistentSet> read(const std::string& path);
  // Writes to a temporary name, then renames. kIo on failure.
  Status write(const std::string& path) const;

  // Returns null before the first window.
  const TrainState* state() const { return state_.get(); }
  bool carries_moving() const { return carries_moving_; }
  // Returns where the members are stored; nothing before the window has been recorded.
  const RecordedSet& recorded() const { return recorded_; }
  void set_recorded(RecordedSet recorded) { recorded_ = std::move(recorded); }
  // See the constructor; empty for a set that was read.
  const std::vector<MemberEnd>& ends() const { return ends_; }
  void set_ends(std::vector<MemberEnd> ends) { ends_ = std::move(ends); }
  // Returns by how much renderings of the set usually differ from images, per training camera
  // (Residual of train/changed_points.h); empty before the second window.
  const std::vector<std::vector<std::uint8_t>>& residuals() const { return residuals_; }
  // Returns the set without the moving content that it carries.
  PersistentSet without_moving() const;
  // Returns the number of stored primitives.
  std::size_t size() const;

 private:
  std::shared_ptr<const TrainState> state_;
  bool carries_moving_ = false;
  RecordedSet recorded_;
  std::vector<std::vector<std::uint8_t>> residuals_;
  std::vector<MemberEnd> ends_;
};

}  // namespace stgs::encoder
