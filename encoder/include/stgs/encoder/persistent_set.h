// SPDX-License-Identifier: Apache-2.0
// The persistent content of a long capture: static primitives that are trained in the window of
// time that first shows them, stored once, and displayed from then on. Later windows render them
// unchanged.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "stgs/format/status.h"

namespace stgs::encoder {

struct TrainState;

// The result of a window that the next one starts from. Copies share the content, which does not
// change; thread-safe.
class PersistentSet {
 public:
  // An empty set, for the first window. `carries_moving`: each window also starts from the moving
  // content at the end of the previous one. It helps if few frames of a window have dynamic points;
  // otherwise these are better.
  explicit PersistentSet(bool carries_moving = false) : carries_moving_(carries_moving) {}
  // See persistent_state() (train/persistence.h).
  PersistentSet(std::shared_ptr<const TrainState> state, bool carries_moving)
      : state_(std::move(state)), carries_moving_(carries_moving) {}

  // Reads a set that does not carry moving content. kIo, or kInvalidFile for a damaged or another
  // file.
  static Result<PersistentSet> read(const std::string& path);
  // Writes to a temporary name, then renames. kIo on failure.
  Status write(const std::string& path) const;

  // Returns null before the first window.
  const TrainState* state() const { return state_.get(); }
  bool carries_moving() const { return carries_moving_; }
  // Returns the set without the moving content that it carries.
  PersistentSet without_moving() const;
  // Returns the number of stored primitives.
  std::size_t size() const;

 private:
  std::shared_ptr<const TrainState> state_;
  bool carries_moving_ = false;
};

}  // namespace stgs::encoder
