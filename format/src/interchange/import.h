// SPDX-License-Identifier: Apache-2.0
// Helpers shared by the readers and writers of other formats.
#pragma once

#include <cstdint>
#include <string>

#include "interchange/import_memory.h"
#include "stgs/format/interchange.h"

namespace stgs {

// Logit of an opacity stored as exactly 1: that of about 1 - 1e-7.
inline constexpr float kOpaqueLogit = 16.0f;

// Greatest sigma of imported primitives, in units of the clip: the visibility is then constant.
inline constexpr double kMaxClipSigma = 65504;

// Lifespans that end at a frame have this sigma, ticks, so that successive primitives cross-fade,
// and end kEdgeWidth earlier: sigma sqrt(ln 255), where even opacity 1 is invisible.
inline constexpr double kEdgeSigma = 1.0 / 1024;
inline constexpr double kEdgeWidth = 2.3541 * kEdgeSigma;

// Returns the logit of an opacity stored as a byte, value / 255. 0 and 255 become the middle of the
// half steps that round to them.
float logit_of_byte(int value);

// Drops primitives that cannot be rendered, with a note. Infinite opacities and scales, as written
// by trainers, become finite. Allocates no memory for primitives.
void drop_invalid(Gaussians4D& set, ConversionNotes* notes);
// Returns a static scene of the valid primitives.
Scene finish_import(Gaussians4D set, ConversionNotes* notes);

// Returns kUsage for a set that no writer accepts: arrays of different lengths, an SH degree
// outside 0..3, values that are not finite, or a rotation of length 0.
Status check_export(const Gaussians4D& set);

// Appends a note, unless `notes` is null.
inline void note(ConversionNotes* notes, std::string text) {
  if (notes != nullptr) notes->push_back(std::move(text));
}

}  // namespace stgs
