// SPDX-License-Identifier: Apache-2.0
// The limit on the memory for opening and validating a file (SECURITY.md).
//
// Each item is charged with an upper bound of its memory; tests/resources measures the bounds.
#pragma once

#include <cstdint>

#include "container/container.h"

namespace stgs {

// Bytes for a link, a run, a segment, one of its tiers, and a further record.
inline constexpr std::uint64_t kOpeningLink = 256, kOpeningRun = 2000, kOpeningSegment = 32,
                               kOpeningTier = 224, kOpeningFurther = 128;
// Bytes for each byte of a record of ends.
inline constexpr std::uint64_t kOpeningEndByte = 32;
// Charged for each page that is read, and again if it is damaged. It bounds the time for pages, not
// their memory.
inline constexpr std::uint64_t kOpeningPage = 4000;

// Returns the bytes for a node.
std::uint64_t opening_bytes(const IndexNode& node);
// Returns the memory of the head and the nodes read so far, bytes, at most.
std::uint64_t opened_bytes(const FileHead& head);
// Returns the bytes that opening may take: ReadLimits::max_opening. `uncounted`: bytes that are
// read besides FileHead::index_bytes.
std::uint64_t opening_limit(const FileHead& head, std::uint64_t uncounted);
// Returns the bytes of them that further nodes may take.
std::uint64_t opening_left(const FileHead& head, std::uint64_t uncounted);
// Checks that `more` bytes of nodes are within the limit. `at`: offset of the record, for the
// message.
bool fits_opening(const FileHead& head, std::uint64_t more, std::uint64_t uncounted,
                  std::uint64_t at, Findings& findings);

}  // namespace stgs
