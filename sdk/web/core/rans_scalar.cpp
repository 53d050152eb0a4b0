// SPDX-License-Identifier: Apache-2.0
// The functions of codec/rans_vector.cpp for WebAssembly, whose vector unit has no gathers: without
// them it decodes at less than half the speed of the scalar loop.
#include "codec/rans_block.h"

namespace stgs {

void rans_decode_vector(RansBlock& block, const RansLookup& lookup, std::size_t count,
                        std::uint8_t* out) {
  rans_decode_scalar(block, lookup, 0, count, out);
}

void rans_decode_blocks(std::span<RansCursor> cursors, std::size_t first) {
  for (RansCursor& cursor : cursors) rans_decode_scalar(cursor, first);
}

}  // namespace stgs
