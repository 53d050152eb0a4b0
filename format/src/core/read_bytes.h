// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/byte_source.h"

namespace stgs {

// Reads `bytes` bytes from `offset` into `out`. A source may state more bytes than it has, so the
// first 8 MiB and then as many as have been read so far are read at a time: the memory is at most
// 16 MiB, or three times the bytes that have arrived.
Status read_bytes(const ByteSource& source, std::uint64_t offset, std::uint64_t bytes,
                  std::vector<std::uint8_t>& out);

}  // namespace stgs
