// SPDX-License-Identifier: Apache-2.0
// Decodes segments of a file into parts that are packed for the GPU, for a worker of the host.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "provided_source.h"
#include "stgs/format/listed_segment.h"
#include "stgs/format/scene_file.h"

namespace stgs::web {

// Opens a file from the bytes with which another instance opened it, and decodes segments that this
// has listed, from the bytes of their records. One thread.
class PartDecoder {
 public:
  // A part of a segment: consecutive primitives.
  struct Part {
    std::uint32_t primitives = 0;
    std::vector<std::uint8_t> packed;  // as packed_segment.h states
  };

  // `max_memory`: bytes for decoding a segment (ReadLimits).
  PartDecoder(std::string name, std::uint64_t file_bytes, std::uint64_t max_memory);

  // The file, of which bytes are provided for open() and before each decode(), which frees them.
  ProvidedSource& source() { return *provided_; }
  // kIo: bytes are missing.
  Status open();
  // The segment to decode.
  ListedSegment& segment() { return segment_; }
  // Decodes it as player::decode_to_render(); open() has succeeded.
  Status decode(bool with_sh, Status& sh);
  // The time from which the times of the decoded segment count, ticks of its part.
  double time_origin() const { return set_.time_origin; }
  // Packs the next part of the decoded segment; null after the last one. Valid until the next call.
  const Part* next_part();

 private:
  // Primitives of a part: its packed data take at most 11 MB.
  static constexpr std::uint32_t kPartPrimitives = 1 << 16;

  ReadLimits limits_;
  std::unique_ptr<ProvidedSource> opening_;  // until open()
  ProvidedSource* provided_;
  std::unique_ptr<SceneReader> reader_;
  ListedSegment segment_;
  Gaussians4D set_;
  std::size_t packed_ = 0;  // primitives
  Part part_;
};

}  // namespace stgs::web
