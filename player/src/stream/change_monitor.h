// SPDX-License-Identifier: Apache-2.0
// Decides whether failures mean that a finished file was replaced.
#pragma once

#include <algorithm>

#include "stgs/format/status.h"

namespace stgs::player {

// What the source of a file reports about changes, ByteSource::has_shrunk() and was_modified().
struct FileChanges {
  bool shrunk = false, modified = false;
};

// Interprets failures of a file that is not growing; a Follower watches growing ones. Times are
// seconds of a monotonic clock. Not thread-safe.
class ChangeMonitor {
 public:
  // The cause of a segment that cannot be decoded.
  enum class Cause {
    kMachine,   // an error of this machine: temporary
    kReplaced,  // data of another file: temporary
    kNotBuilt,  // a feature that this build lacks: permanent
    kDamage     // invalid data in the right file: permanent
  };

  explicit ChangeMonitor(double retry_seconds)
      : suspect_seconds_(std::max(kSuspectSeconds, 3 * retry_seconds)) {}

  // Returns whether the file is replaced, as far as known.
  bool is_replaced() const { return is_replaced_; }

  // Records a failed read.
  void read_failed(bool growing, const FileChanges& changes) {
    if (!growing && changes.shrunk) is_replaced_ = true;
  }
  // Records a segment that could not be decoded.
  Cause decode_failed(StatusCode code, bool growing, const FileChanges& changes, double now) {
    if (code == StatusCode::kNotBuilt) return Cause::kNotBuilt;
    if (!is_damage(code)) return Cause::kMachine;
    if (growing || !(changes.shrunk || changes.modified)) return Cause::kDamage;
    is_replaced_ = true;
    suspect_until_ = now + suspect_seconds_;
    return Cause::kReplaced;
  }
  // Records a decoded segment. Returns true if the file has just proved to be the right one again:
  // the data was fetched after the replacement.
  bool decoded(const FileChanges& changes, double now) {
    if (!is_replaced_ || now <= suspect_until_ || changes.shrunk) return false;
    is_replaced_ = false;
    return true;
  }

 private:
  // Minimum time without data of another file before the file counts as the right one again:
  // longer than failed layers wait for their retry.
  static constexpr double kSuspectSeconds = 30;

  const double suspect_seconds_;
  bool is_replaced_ = false;
  double suspect_until_ = 0;  // data fetched until then may be of another file
};

}  // namespace stgs::player
