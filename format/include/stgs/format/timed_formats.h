// SPDX-License-Identifier: Apache-2.0
// Import of formats whose primitives move and fade in and out as a Gaussian of time: .sogst, .tsog
// and .ftgs.ply. A standard deviation s of time becomes sigma = s sqrt(2) with r = 0, which is the
// same visibility. Axes: as 3DGS PLY; the files do not state others.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "stgs/format/interchange.h"

namespace stgs {

// Bounds for the division of curved paths into lines, each of which is one primitive.
struct CurveSettings {
  // Distance between path and line while the primitive is visible, in units of its middle standard
  // deviation.
  double position = 0.1;
  // Difference of the opacity at a frame, 0..1. A primitive that is divided fades in steps.
  double opacity = 0.02;
};

struct CurveReport {
  std::uint64_t primitives = 0;  // of the file
  std::uint64_t curved = 0;      // of those, with an acceleration
  std::uint64_t divided = 0;     // of those, represented by several primitives
  std::uint64_t pieces = 0;      // primitives that represent the divided ones
  // Divided ones with a distance above the bound: they would need more than 15 pieces per frame, or
  // 4096 in total.
  std::uint64_t above_bound = 0;
  // Greatest distance between path and line, scene units and middle standard deviations.
  double position_max = 0, position_relative_max = 0;
  double opacity_max = 0;  // at a frame, 0..1
};

// Reads .sogst version 1: a bundle as SOG's, with linear or quadratic motion. The whole archive is
// read, also if it has the streamed layout. Pieces of a divided primitive are successive, in the
// order of time. kNotBuilt without libwebp or libzip.
Result<Scene> read_sogst(const std::string& path, const CurveSettings& settings = {},
                         const ReadLimits& limits = {}, CurveReport* report = nullptr,
                         ConversionNotes* notes = nullptr);

// Timing of files that store times relative to the clip. kUsage if the file states the same value.
struct ClipSettings {
  std::optional<std::uint32_t> frames;  // >= 1; default: 300
  std::optional<TimeBase> frame_time;   // default: 1/30 s
};

// Reads .tsog version 4: a bundle as SOG's, static, with frames, or with linear motion. kNotBuilt
// without libwebp or libzip.
Result<Scene> read_tsog(const std::string& path, const ClipSettings& settings = {},
                        const ReadLimits& limits = {}, ConversionNotes* notes = nullptr);

// Reads version 1 of the PLY files of FreeTimeGsVanilla (.ftgs.ply).
Result<Scene> read_ftgs_ply(const ByteSource& source, const ClipSettings& settings = {},
                            const ReadLimits& limits = {}, ConversionNotes* notes = nullptr);
// Returns whether a file that begins with `head` is such a file.
bool is_ftgs_ply(std::span<const std::uint8_t> head);

}  // namespace stgs
