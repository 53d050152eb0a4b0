// SPDX-License-Identifier: Apache-2.0
// The payload of a SEGM record: who it is, its stream table, its streams (spec 6).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "container.h"
#include "stream.h"

namespace stgs {

inline constexpr std::size_t kSegmentHeaderBytes = 16;

std::vector<std::uint8_t> write_segment(const IndexEntry& entry,
                                        std::span<const EncodedStream> streams);

// A row of the table with the bytes that it describes.
struct LocatedStream {
  StreamEntry entry;
  std::uint64_t offset = 0;  // in the file
  std::span<const std::uint8_t> stored;
};

// Checks the table of a record against its index row; `offset` is the payload's place in the file,
// `ordinal` the segment's number for messages. Streams that may be skipped are left out.
bool parse_segment(std::span<const std::uint8_t> payload, std::uint64_t offset,
                   std::uint32_t ordinal, const IndexEntry& expected, const FileMetadata& metadata,
                   std::vector<LocatedStream>& streams, Findings& findings);

// Decodes all streams; what could be decoded is in `set` even where the answer is false.
bool decode_streams(std::span<const LocatedStream> streams, std::uint32_t ordinal,
                    std::uint32_t primitives, const FileMetadata& metadata, Gaussians4D& set,
                    Findings& findings);

// A segment's stored bytes and the streams in them.
struct SegmentRecords {
  std::vector<std::uint8_t> base, harmonics;
  std::vector<LocatedStream> streams;  // in the order of their attributes
};
// Reads and checks the records of segment `ordinal` of a file; its harmonics above degree 0 only
// where they are asked for or are no record of their own.
bool read_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                  bool with_harmonics, SegmentRecords& records, Findings& findings);

}  // namespace stgs
