// SPDX-License-Identifier: Apache-2.0
// Opening and decoding a group of planes.
#include "codec/rans.h"

#include <algorithm>

#include "codec/rans_block.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

constexpr std::size_t kBlockGrain = 8;  // blocks per task: about 0.1 ms

std::size_t block_size(std::size_t n, std::size_t block) {
  return std::min(n - block * kRansBlock, kRansBlock);
}

}  // namespace

Result<std::vector<RansBlockLocation>> rans_layout(std::span<const std::uint8_t> bytes,
                                                   std::size_t n) {
  const std::size_t count = rans_blocks(n);
  if (count == 0) {
    if (bytes.empty()) return std::vector<RansBlockLocation>{};
    return invalid_file("group of no symbols with {} bytes", bytes.size());
  }
  // Each block has at least a state, and all but the last a size.
  if (count > (bytes.size() + 4) / 8) {
    return invalid_file("group too short ({} bytes for {} symbols per plane)", bytes.size(), n);
  }
  ByteReader sizes(bytes), data(bytes);
  data.bytes(4 * (count - 1));
  std::vector<RansBlockLocation> blocks(count);
  for (std::size_t b = 0; b < count; ++b) {
    const std::size_t states = 4 * rans_lanes(block_size(n, b));
    const bool last = b + 1 == count;
    // The words of the last block end with the group.
    const std::uint64_t rest = data.left() > states ? data.left() - states : 0;
    blocks[b] = {data.position(),
                 last ? static_cast<std::uint32_t>(std::min<std::uint64_t>(rest / 2, 0xFFFFFFFF))
                      : sizes.u32()};
    bool possible = true;
    for (std::size_t lane = 0; lane < rans_lanes(block_size(n, b)); ++lane)
      possible = data.u32() >= kRansLow && possible;
    data.bytes(std::uint64_t{2} * blocks[b].words);
    if (!data.ok() || !possible) {
      return invalid_file("block {} at byte {} of the group: {}", b, blocks[b].states,
                          data.ok() ? "state below 65536" : "extends past the group");
    }
  }
  if (data.left() != 0) {
    return invalid_file("extra bytes after the blocks of the group (expected {}, got {})",
                        data.position(), bytes.size());
  }
  return blocks;
}

RansGroupDecoder::RansGroupDecoder(std::unique_ptr<RansBlock[]> blocks, std::size_t n, bool scalar)
    : blocks_(std::move(blocks)), n_(n), scalar_(scalar) {}
RansGroupDecoder::RansGroupDecoder(RansGroupDecoder&&) noexcept = default;
RansGroupDecoder& RansGroupDecoder::operator=(RansGroupDecoder&&) noexcept = default;
RansGroupDecoder::~RansGroupDecoder() = default;

Result<RansGroupDecoder> RansGroupDecoder::open(std::span<const std::uint8_t> bytes, std::size_t n,
                                                bool scalar) {
  STGS_ASSIGN(const std::vector<RansBlockLocation> locations, rans_layout(bytes, n));
  auto blocks = std::make_unique<RansBlock[]>(locations.size());
  for (std::size_t b = 0; b < locations.size(); ++b) {
    RansBlock& block = blocks[b];
    block.lanes = rans_lanes(block_size(n, b));
    ByteReader data(bytes.subspan(locations[b].states));
    for (std::size_t lane = 0; lane < block.lanes; ++lane) block.state[lane] = data.u32();
    const auto coded = data.bytes(std::uint64_t{2} * locations[b].words);
    block.next = coded.data();
    block.end = coded.data() + coded.size();
  }
  return RansGroupDecoder(std::move(blocks), n, scalar);
}

void RansGroupDecoder::next_plane(const RansLookup& lookup, std::uint8_t* out) {
  const auto decode = [&](std::size_t begin, std::size_t end) {
    for (std::size_t b = begin; b < end; ++b) {
      std::uint8_t* const first = out + b * kRansBlock;
      if (scalar_) {
        rans_decode_scalar(blocks_[b], lookup, block_size(n_, b), first);
      } else {
        rans_decode_vector(blocks_[b], lookup, block_size(n_, b), first);
      }
    }
  };
  const std::size_t count = rans_blocks(n_);
  if (count <= kBlockGrain) {  // starting a task takes as long as decoding a short block
    decode(0, count);
  } else {
    parallel_blocks(std::size_t{0}, count, kBlockGrain, decode);
  }
}

void decode_groups(std::span<const RansQueue> groups, std::size_t begin, std::size_t end) {
  std::size_t most = 0;
  for (const RansQueue& queue : groups) most = std::max(most, queue.group->n_);
  const std::size_t first = begin / kRansBlock, last = rans_blocks(std::min(end, most));
  const auto decode = [&](std::size_t b) {
    std::vector<RansCursor> cursors;
    for (const RansQueue& queue : groups) {
      const std::size_t n = queue.group->n_;
      if (b >= rans_blocks(n)) continue;
      cursors.push_back({&queue.group->blocks_[b], queue.planes.data(),
                         queue.planes.data() + queue.planes.size(), block_size(n, b)});
    }
    rans_decode_blocks(cursors, (b - first) * kRansBlock);
  };
  if (first >= last) return;
  if (last - first == 1) {
    decode(first);
  } else {
    parallel_for(first, last, decode);
  }
}

bool RansGroupDecoder::finish() const {
  return std::all_of(blocks_.get(), blocks_.get() + rans_blocks(n_), [](const RansBlock& block) {
    return !block.overrun && block.next == block.end &&
           std::all_of(block.state, block.state + block.lanes,
                       [](std::uint32_t x) { return x == kRansLow; });
  });
}

}  // namespace stgs
