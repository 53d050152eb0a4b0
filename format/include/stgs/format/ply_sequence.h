// SPDX-License-Identifier: Apache-2.0
// Import of a folder of PLY files, one complete model per frame, as primitives with lifespans.
//
// A splat that stays the same from frame to frame, or moves at a constant velocity, becomes one
// primitive for the whole run of frames. Rendering at the time of a frame reproduces that frame
// within the tolerances. A run is visible from half a frame before its first frame to half a frame
// after its last one, and moves continuously between frames.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/format/interchange.h"

namespace stgs {

// Maximum differences between a splat of a frame and the primitive that represents it.
struct SequenceTolerances {
  double position = 0.02;        // in units of its middle standard deviation
  double log_scale = 0.02;       // natural log, per axis
  double rotation = 0.02;        // shift of its longest axis's end, in middle standard deviations
  double opacity = 1.0 / 255.0;  // 0..1
  double colour = 1.0 / 255.0;   // seen from any direction, 0..1
};

struct SequenceSettings {
  TimeBase frame_time{1, 30};  // duration of one frame
  SequenceTolerances tolerances;
};

struct SequenceReport {
  std::uint32_t frames = 0;
  std::uint64_t splats = 0;  // in all frames
  std::uint64_t first_frame_splats = 0;
  std::uint64_t primitives = 0;  // created from them
  std::uint64_t whole_clip = 0;  // primitives that cover every frame
  std::uint64_t moving = 0;      // primitives with a velocity
  // Greatest difference between a splat and its primitive, in the units of the tolerances. For
  // moving primitives the position's is an upper bound.
  SequenceTolerances errors{0, 0, 0, 0, 0};
  double position_error = 0;  // of the position, in scene units

  // Returns the share of the splats after the first frame that continue a primitive; 1 if there is
  // one frame.
  double matched() const;
};

// Reads folder/*.ply in the order of the last number in their names, which must increase in equal
// steps. Keeps one frame in memory in addition to the result. Splats may be in any order, but a
// common order is faster. The result does not depend on the number of threads.
Result<Scene> read_ply_sequence(const std::string& folder, const SequenceSettings& settings = {},
                                const ReadLimits& limits = {}, SequenceReport* report = nullptr,
                                ConversionNotes* notes = nullptr);
// Returns whether the folder contains a PLY file.
bool is_ply_sequence(const std::string& folder);

}  // namespace stgs
