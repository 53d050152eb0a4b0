// SPDX-License-Identifier: Apache-2.0
// What a file asks of whoever plays it, from its index alone (spec/decoder-model.md).
#pragma once

#include <cstdint>

#include "stgs/format/scene_file.h"

namespace stgs {

struct DecoderNeeds {
  // Of the segments of a moment, all tiers and harmonics, at the moment that has most.
  std::uint64_t primitives = 0, segments = 0;
  std::uint64_t bytes = 0;           // of their records: what a seek fetches
  std::uint64_t decoded_bytes = 0;   // of their floats
  std::uint64_t ranges = 0;          // of the file that hold them
  std::uint64_t index_bytes = 0;     // the first read
  std::uint64_t startup_bytes = 0;   // the index, and what begins within the first second
  double bits_per_second = 0;        // what brings the rest in time
  double primitives_per_second = 0;  // what decodes the rest in time
  int level = 0;                     // the least that has room for this; 0: none has
};

// Of a file in full, at its own speed.
DecoderNeeds decoder_needs(const SceneReader& reader);

}  // namespace stgs
