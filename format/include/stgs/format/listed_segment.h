// SPDX-License-Identifier: Apache-2.0
// Segments for decoders that have not loaded the index of their file.
#pragma once

#include <cstdint>
#include <span>

#include "stgs/format/segment_ends.h"

namespace stgs {

class SceneReader;

// A segment and its part as listed in the index: everything that decoding needs besides the head of
// the file. Trivially copyable, also to another process of the same build.
struct ListedSegment {
  std::uint32_t number = 0;  // index of the segment in the reader that listed it
  std::uint32_t slot = 0, primitives = 0;
  std::int16_t level = 0;
  std::uint16_t layer = 0;
  std::uint64_t offset = 0, bytes = 0;        // of the base record
  std::uint64_t sh_offset = 0, sh_bytes = 0;  // of the SH record; 0 bytes: there is none
  double part_begin = 0, part_end = 0, chunk_ticks = 0;

  // Returns a loaded segment of a reader.
  static ListedSegment of(const SceneReader& reader, std::uint32_t segment);
  // Makes this the only segment of a reader of the same file, which may have been opened when the
  // file was shorter. `ends`: SceneReader::ends() of the reader that listed it. From then on only
  // the functions that decode may be called, with `number`.
  void replace_segments(SceneReader& reader, std::span<const SegmentEnd> ends = {}) const;
};

}  // namespace stgs
