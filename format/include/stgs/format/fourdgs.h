// SPDX-License-Identifier: Apache-2.0
// Import and export of .4dgs (github.com/avala-ai/4dgs), version 1, a container of Gaussians that
// move linearly and fade in and out as a Gaussian of time within hard validity windows.
//
// Import, temporal model gaussian-birth: a fade becomes a lifespan with r = 0 and sigma = sqrt(2)
// standard deviations. A Gaussian that never fades becomes a flat top as long as its window. Fades
// that their window cuts off are put into a part of the scene (ScenePart) with the times of the
// window. The clip has no frame rate; the settings give one.
//
// Import, temporal model keyframe-delta: the states are evaluated at the frames and merged into
// primitives as read_ply_sequence() does, by the identities that the file stores.
//
// Export: temporal model gaussian-birth. See write_4dgs().
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "stgs/format/interchange.h"
#include "stgs/format/ply_sequence.h"

namespace stgs {

struct FourdgsSettings {
  // Duration of one frame. None: that of write_4dgs(), if it wrote the file; for keyframe-delta one
  // that divides the states evenly into at least 24 frames per second; else 1/30 s.
  std::optional<TimeBase> frame_time;
  std::optional<SequenceTolerances> tolerances;  // for keyframe-delta only; none: the defaults
};

struct FourdgsReport {
  // Fades that the file cuts off, and that are continued here until they are invisible. The opacity
  // at the cut, 0..1, is the error.
  std::uint64_t continued_fades = 0;
  double cut_max = 0;
  std::optional<SequenceReport> sequence;  // set for keyframe-delta
};

// Reads a .4dgs file. Axes: as 3DGS PLY, unless the file states that y points up. The camera
// becomes the start camera.
//
// kUsage for tolerances with gaussian-birth, which is not matched.
// kUnsupported for temporal models and colour spaces other than those of version 1, for object
// tracks that move primitives, and for a clip without end.
Result<Scene> read_4dgs(const ByteSource& source, const FourdgsSettings& settings = {},
                        const ReadLimits& limits = {}, FourdgsReport* report = nullptr,
                        ConversionNotes* notes = nullptr);

// Writes a scene as .4dgs with the temporal model gaussian-birth and zlib streams. `order`, unless
// null, receives for each Gaussian of the file its index in `scene`; primitives that are never
// visible are omitted. kUnsupported for a scene that exceeds the format's ranges.
//
// The format has no lifespan with a flat top and a fade. Each primitive gets whichever of these has
// the smaller integrated squared error of l(t) over the clip:
// - the Gaussian that minimises the integrated squared error over all times
// - full visibility over the frames at which l(t) >= 1/2
// A note gives the greatest and the rms error of l(t).
//
// Rounds, with bounds that the file declares:
// - positions to 1/50 of a size that three quarters of the primitives exceed
// - scales and sigma to 0.5 %, rotation components to 0.0005
// - opacity and colour to half an 8-bit step; SH to 8 bits
//
// Clips, with a note: colours to [0, 1], SH to [-4, 4].
Result<std::vector<std::uint8_t>> write_4dgs(const Scene& scene, ConversionNotes* notes = nullptr,
                                             std::vector<std::uint32_t>* order = nullptr);

// Reads a file of write_4dgs() for a comparison with its scene: in the order of the file, and
// without cutting fades off at the ends of parts.
Result<Scene> read_back_4dgs(const ByteSource& source, const ReadLimits& limits = {});

// Returns whether a file that begins with `head` is a .4dgs file of any version.
bool is_4dgs(std::span<const std::uint8_t> head);

}  // namespace stgs
