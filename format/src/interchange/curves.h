// SPDX-License-Identifier: Apache-2.0
// Division of quadratic paths into lines with adjacent lifespans.
#pragma once

#include <vector>

#include "interchange/import_memory.h"
#include "stgs/format/timed_formats.h"

namespace stgs {

// Returns primitives of linear motion for those of `set` (radius 0), whose centre is at
// X + u dt + a dt^2. `acceleration` has N x 3 values a, scene units per tick^2. Times in
// [0, frames] count. A path whose best line is within the bound keeps its lifespan; others are
// divided into pieces that are rendered from half a frame before their first frame to half a frame
// after their last one, in shorter pieces where the bound requires it. The result is charged to
// `memory`, before it is allocated.
Result<Charged<Gaussians4D>> divide_curves(const Gaussians4D& set,
                                           const std::vector<float>& acceleration,
                                           std::uint32_t frames, const CurveSettings& settings,
                                           ImportMemory& memory, CurveReport& report);

// Appends notes of the errors in a report.
void note_curves(const CurveReport& report, const CurveSettings& settings, ConversionNotes* notes);

}  // namespace stgs
