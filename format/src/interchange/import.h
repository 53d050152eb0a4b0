// SPDX-License-Identifier: Apache-2.0
// What the readers and writers of other formats share.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/format/interchange.h"

namespace stgs {

// What an opacity that is stored as exactly 1 becomes: the logit of 1 - 1e-7 or so.
inline constexpr float kOpaqueLogit = 16.0f;

// Whether `count` primitives of that degree are within the limits; `name` is for the message.
Status check_import_size(const std::string& name, std::uint64_t count, int sh_degree,
                         const ReadLimits& limits);

// The logit of an opacity of [0, 1] that was stored in steps of 1/255. The two ends stand for the
// half step that rounds to them, whose middle is taken.
float logit_of_byte(int value);

// Leaves out primitives that cannot be drawn, with a note; opacities and scales that are infinite,
// as trainers write them, become finite.
void keep_drawable(Gaussians4D& set, ConversionNotes* notes);
// A static scene of what was decoded and can be drawn.
Scene finish_import(Gaussians4D set, ConversionNotes* notes);

// kUsage for a set that no writer takes: arrays that differ in length, a degree beyond 0..3, values
// that are not finite, a rotation of length 0.
Status check_export(const Gaussians4D& set);

// Appends to notes that may not be there.
inline void note(ConversionNotes* notes, std::string text) {
  if (notes != nullptr) notes->push_back(std::move(text));
}

}  // namespace stgs
