// SPDX-License-Identifier: Apache-2.0
// Decoder requirements of a file, computed from its index alone (spec/decoder-model.md).
#pragma once

#include <cstdint>

#include "stgs/format/scene_file.h"

namespace stgs {

struct DecoderNeeds {
  // Peak over all times, summed over the segments needed at one time, with all tiers and SH.
  std::uint64_t primitives = 0, segments = 0;
  std::uint64_t bytes = 0;           // of their records: the bytes that a seek fetches
  std::uint64_t decoded_bytes = 0;   // of their floats
  std::uint64_t ranges = 0;          // contiguous byte ranges that hold the records
  std::uint64_t index_bytes = 0;     // of the first read
  std::uint64_t startup_bytes = 0;   // the index, plus segments that begin within the first second
  double bits_per_second = 0;        // rate that delivers the other segments in time
  double primitives_per_second = 0;  // rate that decodes the other segments in time
  int level = 0;                     // lowest level that covers all of this; 0: none does
};

// Computes the requirements of playing the complete file at its own speed.
DecoderNeeds decoder_needs(const SceneReader& reader);

}  // namespace stgs
