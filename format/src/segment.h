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

// Checks the table of segment `ordinal` against its index entry; `offset` is the payload's place in
// the file. Streams that may be skipped are left out.
bool parse_segment(std::span<const std::uint8_t> payload, std::uint64_t offset,
                   std::uint32_t ordinal, const IndexEntry& expected, const FileMetadata& metadata,
                   std::vector<LocatedStream>& streams, Findings& findings);

// Decodes all streams; what could be decoded is in `set` even where the answer is false.
bool decode_streams(std::span<const LocatedStream> streams, std::uint32_t ordinal,
                    std::uint32_t primitives, const FileMetadata& metadata, Gaussians4D& set,
                    Findings& findings);

// Reads, checks and decodes segment `ordinal` of a file.
bool read_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                  std::vector<LocatedStream>& streams, std::vector<std::uint8_t>& record,
                  Findings& findings);

}  // namespace stgs
