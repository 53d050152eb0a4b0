// SPDX-License-Identifier: Apache-2.0
// Import of .splatv, the format of the splaTV viewer (github.com/antimatter15/splaTV): primitives
// of 64 bytes that move along cubic paths, rotate, and fade in and out as a Gaussian of time.
//
// A primitive of .stgs fades in the same way (r = 0) but moves along a straight line and does not
// rotate. Each primitive gets the line and the rotation that fit best while it is visible. The
// report gives the remaining error.
#pragma once

#include <cstdint>

#include "stgs/format/interchange.h"

namespace stgs {

struct SplatvSettings {
  // Length of the clip. The file's time runs from 0 to 1 without a frame count.
  std::uint32_t frames = 50;   // >= 1
  TimeBase frame_time{1, 30};  // duration of one frame
  // A path counts as bent if the line deviates from it by more than this many of the primitive's
  // middle standard deviations.
  double bend = 0.5;
};

struct SplatvReport {
  std::uint64_t primitives = 0;  // imported
  std::uint64_t bent = 0;        // of those, with a bent path
  // Distance between path and line while the primitive is visible, scene units. The rms is over the
  // greatest distance of each primitive.
  double path_max = 0, path_rms = 0;
  double rotation_max = 0;  // degrees
};

// Reads a .splatv file. Axes: as 3DGS PLY. The first camera becomes the start camera.
Result<Scene> read_splatv(const ByteSource& source, const SplatvSettings& settings = {},
                          const ReadLimits& limits = {}, SplatvReport* report = nullptr,
                          ConversionNotes* notes = nullptr);
// Returns whether a file that begins with `head` is a .splatv file.
bool is_splatv(std::span<const std::uint8_t> head);

}  // namespace stgs
