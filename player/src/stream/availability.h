// SPDX-License-Identifier: Apache-2.0
// The data that playback can show, as Playback sees it.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs::player {

// The extent of a file, which grows while it is recorded.
struct ClipExtent {
  std::uint32_t frames = 0;
  bool growing = false;            // more may follow
  std::uint64_t file_bytes = 0;    // of complete content
  double last_fragment_begin = 0;  // ticks; the end is `frames`
};

// Returns the extent of a file as a reader knows it.
inline ClipExtent extent_of(const SceneReader& reader) {
  ClipExtent out;
  out.frames = reader.metadata().frames;
  out.growing = reader.form() == SceneForm::kGrowing;
  out.file_bytes = reader.file_bytes();
  out.last_fragment_begin = reader.segments().empty() ? out.frames : reader.latest_begin_ticks();
  return out;
}

class Availability {
 public:
  virtual ~Availability() = default;
  // Returns the extent of the file as it is known at present.
  virtual ClipExtent extent() const = 0;
  // Returns whether layer 0 is final at `ticks`: nothing more of it will arrive.
  virtual bool ready(double ticks) const = 0;
  // Returns the disjoint ranges in which layer 0 is final, ascending.
  virtual std::vector<TickRange> ready_ranges() const = 0;
};

}  // namespace stgs::player
