// SPDX-License-Identifier: Apache-2.0
// Opens a group of planes and decodes it.
#include "rans.h"

#include <algorithm>

#include "rans_block.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

constexpr std::size_t kGrain = 32;  // blocks of a task: some 0.1 ms

std::size_t block_size(std::size_t n, std::size_t block) {
  return std::min(n - block * kRansBlock, kRansBlock);
}

}  // namespace

RansGroupDecoder::RansGroupDecoder(std::unique_ptr<RansBlock[]> blocks, std::size_t n, bool scalar)
    : blocks_(std::move(blocks)), n_(n), scalar_(scalar) {}
RansGroupDecoder::RansGroupDecoder(RansGroupDecoder&&) noexcept = default;
RansGroupDecoder& RansGroupDecoder::operator=(RansGroupDecoder&&) noexcept = default;
RansGroupDecoder::~RansGroupDecoder() = default;

Result<RansGroupDecoder> RansGroupDecoder::open(std::span<const std::uint8_t> bytes, std::size_t n,
                                                bool scalar) {
  const std::size_t count = rans_blocks(n);
  // Each block has a size and a state at least; so what follows cannot overflow.
  if (count > bytes.size() / 8) {
    return invalid_file("group of {} bytes: too short for {} primitives", bytes.size(), n);
  }
  ByteReader sizes(bytes), data(bytes);
  data.bytes(4 * count);
  auto blocks = std::make_unique<RansBlock[]>(count);
  for (std::size_t b = 0; b < count; ++b) {
    RansBlock& block = blocks[b];
    const std::uint64_t words = sizes.u32();
    block.lanes = rans_lanes(block_size(n, b));
    const std::size_t at = data.position();
    bool possible = true;
    for (std::size_t lane = 0; lane < block.lanes; ++lane) {
      block.state[lane] = data.u32();
      possible = possible && block.state[lane] >= kRansLow;
    }
    const auto coded = data.bytes(2 * words);
    if (!data.ok() || !possible) {
      return invalid_file("block {} of a group, at its byte {}: {}", b, at,
                          data.ok() ? "a state below 65536" : "ends after the group");
    }
    block.next = coded.data();
    block.end = coded.data() + coded.size();
  }
  if (data.left() != 0) {
    return invalid_file("group of {} bytes: its blocks end at byte {}", bytes.size(),
                        data.position());
  }
  return RansGroupDecoder(std::move(blocks), n, scalar);
}

void RansGroupDecoder::next_plane(const RansLookup& lookup, std::uint8_t* out) {
  parallel_blocks(std::size_t{0}, rans_blocks(n_), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t b = begin; b < end; ++b) {
      std::uint8_t* const first = out + b * kRansBlock;
      if (scalar_) {
        rans_decode_scalar(blocks_[b], lookup, 0, block_size(n_, b), first);
      } else {
        rans_decode_vector(blocks_[b], lookup, block_size(n_, b), first);
      }
    }
  });
}

bool RansGroupDecoder::finish() const {
  return std::all_of(blocks_.get(), blocks_.get() + rans_blocks(n_), [](const RansBlock& block) {
    return !block.overrun && block.next == block.end &&
           std::all_of(block.state, block.state + block.lanes,
                       [](std::uint32_t x) { return x == kRansLow; });
  });
}

}  // namespace stgs
