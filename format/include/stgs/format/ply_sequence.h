// SPDX-License-Identifier: Apache-2.0
// A folder of PLY files, each the whole model at one frame, read into primitives with lifespans.
//
// A splat that stays the same from frame to frame, or moves on at one velocity, becomes one
// primitive for all the frames of its run. What is drawn at the instant of a frame is that frame
// within the tolerances; a run is drawn from half a frame before its first frame to half a frame
// after its last, and moves between frames instead of jumping.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/format/interchange.h"

namespace stgs {

// How far a splat of a frame may be from the primitive that stands for it.
struct SequenceTolerances {
  double position = 0.02;   // of its middle standard deviation
  double log_scale = 0.02;  // of each axis
  double rotation = 0.02;   // where its longest axis points, in middle standard deviations
  double opacity = 1.0 / 255.0;
  double colour = 1.0 / 255.0;  // from any direction, of the range 0 to 1
};

struct SequenceSettings {
  TimeBase frame_time{1, 30};  // of one frame
  SequenceTolerances tolerances;
};

struct SequenceReport {
  std::uint32_t frames = 0;
  std::uint64_t splats = 0;  // of all frames
  std::uint64_t first_frame_splats = 0;
  std::uint64_t primitives = 0;  // made of them
  std::uint64_t whole_clip = 0;  // of the primitives: cover every frame
  std::uint64_t moving = 0;      // of the primitives: have a velocity
  // Largest difference between a splat and its primitive, in the units of the tolerances. The
  // position's is an upper bound for what moves.
  SequenceTolerances errors{0, 0, 0, 0, 0};
  double position_error = 0;  // the same for the position, in scene units

  // Share of the splats, all frames' but the first's, that continue a primitive; 1 for one frame.
  double matched() const;
};

// Reads DIR/*.ply in the order of the last number of their names, which must go up in equal steps.
// Holds one frame beside the result. The order of the splats in the files does not matter, but a
// common one is faster. Does not depend on the number of threads.
Result<Scene> read_ply_sequence(const std::string& folder, const SequenceSettings& settings = {},
                                const ReadLimits& limits = {}, SequenceReport* report = nullptr,
                                ConversionNotes* notes = nullptr);
// Whether the folder has a PLY file in it.
bool is_ply_sequence(const std::string& folder);

}  // namespace stgs
