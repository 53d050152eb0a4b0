// SPDX-License-Identifier: Apache-2.0
// Decodes segments of a file into parts that are packed for the GPU, for a worker of the host.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "provided_source.h"
#include "stgs/format/listed_segment.h"
#include "stgs/format/scene_file.h"

namespace stgs::web {

// Opens a file from the bytes with which another instance opened it, and decodes segments listed by
// that instance, from the bytes of their records. One thread.
class PartDecoder {
 public:
  // A part of a segment: consecutive primitives.
  struct Part {
    std::uint32_t primitives = 0;
    std::span<const std::uint8_t> packed;  // as packed_segment.h states
  };

  // `max_memory`: bytes for decoding a segment (ReadLimits).
  PartDecoder(std::string name, std::uint64_t file_bytes, std::uint64_t max_memory);

  // The file, of which bytes are provided for open() and before each decode(), which frees them.
  ProvidedSource& source() { return *provided_; }
  // kIo: bytes are missing.
  Status open();
  // The segment to decode.
  ListedSegment& segment() { return segment_; }
  // Decodes the segment as player::decode_to_render() does, after open() has succeeded.
  Status decode(bool with_sh, Status& sh);
  // The time from which the times of the decoded segment count, ticks of its part.
  double time_origin() const { return time_origin_; }
  // Returns the next part of the decoded segment, valid until the next call; null after the last
  // one.
  const Part* next_part();

 private:
  // Primitives of a part: its packed data take at most 11 MB.
  static constexpr std::uint32_t kPartPrimitives = 1 << 16;

  // Decodes the records of the segment and packs its primitives.
  Status fill(bool with_sh);
  // Packs `set`: the primitives of a segment of n from number `begin` on.
  void pack_range(const Gaussians4D& set, std::size_t begin, std::uint32_t n);
  // Allocates uninitialised memory for packed primitives.
  void allocate(std::size_t bytes);
  // Bytes of the parts before primitive `begin`, a multiple of kPartPrimitives.
  std::size_t bytes_before(std::size_t begin) const;

  ReadLimits limits_;
  std::unique_ptr<ProvidedSource> opening_;  // until open()
  ProvidedSource* provided_;
  std::unique_ptr<SceneReader> reader_;
  ListedSegment segment_;
  Gaussians4D set_;                          // of a segment that is not packed yet; else empty
  std::unique_ptr<std::uint8_t[]> packed_;   // the parts of the segment, or the last one of set_
  std::size_t capacity_ = 0;                 // bytes
  std::uint32_t primitives_ = 0, next_ = 0;  // of the segment, and the first of the next part
  double time_origin_ = 0;
  Part part_;
};

}  // namespace stgs::web
