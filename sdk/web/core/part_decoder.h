// SPDX-License-Identifier: Apache-2.0
// Decodes segments of a file into parts that are packed for the GPU, for a worker of the host.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "provided_source.h"
#include "stgs/format/listed_segment.h"
#include "stgs/format/scene_file.h"

namespace stgs::web {

// Returns the message with which an instance of the module lets another one decode a segment.
std::vector<std::uint8_t> write_job(const SceneReader& reader, std::uint32_t segment);

// Opens a file from the bytes with which another instance opened it, and decodes segments listed by
// that instance, from the bytes of their records. One thread.
class PartDecoder {
 public:
  // Receives a segment in parts: consecutive primitives, packed as packed_segment.h states.
  class Parts {
   public:
    // Begins a part of primitives [first, first + count), which take `bytes`. The one with `first`
    // = 0 replaces all parts before it.
    virtual void begin(std::uint32_t first, std::uint32_t count, std::uint64_t bytes) = 0;
    // Receives bytes of this part from `offset` on; all of them are passed once.
    virtual void fill(std::uint64_t offset, std::span<const std::uint8_t> bytes) = 0;

   protected:
    ~Parts() = default;
  };

  // `max_memory`: bytes for decoding a segment (ReadLimits).
  PartDecoder(std::string name, std::uint64_t file_bytes, std::uint64_t max_memory);

  // The file, of which bytes are provided for open() and before each decode(), which frees them.
  ProvidedSource& source() { return *provided_; }
  // kIo: bytes are missing.
  Status open();
  // Returns memory for the segment to decode, a message of write_job().
  std::span<std::uint8_t> job(std::size_t bytes) {
    job_.resize(bytes);
    return job_;
  }
  // Decodes the segment as player::decode_to_render() does, after open() has succeeded, and passes
  // its parts, from the first one again if only its SH are damaged. After an error, they are
  // invalid.
  Status decode(bool with_sh, Parts& parts, Status& sh);
  // The time from which the times of the decoded segment count, ticks of its part.
  double time_origin() const { return time_origin_; }

 private:
  // Primitives of a part: its packed data take at most 11 MB.
  static constexpr std::uint32_t kPartPrimitives = 1 << 16;

  // Makes the segment of the job that of the reader.
  Status read_job();
  // Decodes the records of the segment and packs its primitives.
  Status decode_records(bool with_sh, Parts& parts);
  // Packs `set`: the primitives of a segment of n from number `begin` on, a multiple of
  // player::kPackedGroup.
  void pack_range(const Gaussians4D& set, std::size_t begin, std::uint32_t n, Parts& parts);
  // Packs `count` primitives of `set` from `first` on to entries of the part in progress, of
  // `total` primitives, from `entry` on.
  void pack(const Gaussians4D& set, std::size_t first, std::uint32_t count, std::uint32_t total,
            std::uint32_t entry, Parts& parts);

  ReadLimits limits_;
  std::unique_ptr<ProvidedSource> opening_;  // until open()
  ProvidedSource* provided_;
  std::unique_ptr<SceneReader> reader_;
  std::vector<std::uint8_t> job_;
  ListedSegment segment_;
  std::vector<std::uint8_t> packed_;  // of pack()
  double time_origin_ = 0;
};

}  // namespace stgs::web
