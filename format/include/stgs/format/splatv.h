// SPDX-License-Identifier: Apache-2.0
// .splatv, the format of the splaTV viewer (github.com/antimatter15/splaTV): primitives of 64 bytes
// that move along cubic paths, turn, and fade in and out as a Gaussian of time.
//
// A primitive of .stgs fades in the same way (r = 0) but moves straight and does not turn: each
// gets the straight path and the rotation that are nearest over the time in which it is seen. The
// report tells how near that is.
#pragma once

#include <cstdint>

#include "stgs/format/interchange.h"

namespace stgs {

struct SplatvSettings {
  // The file's time runs from 0 to 1; how many frames that is, it does not say.
  std::uint32_t frames = 50;   // >= 1
  TimeBase frame_time{1, 30};  // of one frame
  // A path is called bent where the straight one leaves it by more than this many of the
  // primitive's middle standard deviations.
  double bend = 0.5;
};

struct SplatvReport {
  std::uint64_t primitives = 0;  // that are kept
  std::uint64_t bent = 0;        // of them
  // Between the primitive's path and the straight one, over the time in which it is seen.
  double path_max = 0, path_rms = 0;  // scene units; rms: of each primitive's largest
  double rotation_max = 0;            // degrees
};

// Axes are those of a 3DGS PLY. The first camera becomes the start camera.
Result<Scene> read_splatv(const ByteSource& source, const SplatvSettings& settings = {},
                          const ReadLimits& limits = {}, SplatvReport* report = nullptr,
                          ConversionNotes* notes = nullptr);
// Whether a file that begins so is one.
bool is_splatv(std::span<const std::uint8_t> head);

}  // namespace stgs
