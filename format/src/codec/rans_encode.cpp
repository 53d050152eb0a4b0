// SPDX-License-Identifier: Apache-2.0
// Encoding a group of planes: the steps of the decoder in reverse order.
#include <algorithm>
#include <memory>

#include "codec/rans.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

constexpr int kReciprocalBits = 44;

// The effect of a symbol on a state.
struct SymbolStep {
  // 2^44 / frequency, rounded up. Multiplied by a state below frequency * 2^20 it exceeds the exact
  // quotient by less than 1 / frequency, so its integer part is exact; the product is below 2^64.
  std::uint64_t reciprocal = 0;
  std::uint32_t frequency = 0, start = 0;
};
using SymbolSteps = std::array<SymbolStep, 256>;

SymbolSteps steps_of(const RansTable& table) {
  SymbolSteps steps;
  std::uint32_t start = 0;
  for (std::size_t s = 0; s < 256; ++s) {
    const std::uint32_t f = table.frequency[s];
    if (f == 0) continue;
    steps[s] = {((std::uint64_t{1} << kReciprocalBits) + f - 1) / f, f, start};
    start += f;
  }
  return steps;
}

Status check_plane(const RansPlane& plane, std::size_t index, std::size_t n) {
  if (plane.symbols.size() != n) {
    return usage_error("plane {}: size mismatch (expected {} symbols, got {})", index, n,
                       plane.symbols.size());
  }
  std::uint32_t sum = 0;
  for (const std::uint32_t f : plane.table->frequency) sum += f;
  if (sum != kRansTotal) {
    return usage_error("plane {}: frequencies add up to {} (expected {})", index, sum, kRansTotal);
  }
  std::array<bool, 256> used{};
  for (const std::uint8_t s : plane.symbols) used[s] = true;
  for (std::size_t s = 0; s < 256; ++s) {
    if (used[s] && plane.table->frequency[s] == 0)
      return usage_error("plane {}: table lacks the symbol {}", index, s);
  }
  return {};
}

// Encodes `count` symbols onto the states, last first. Words are written before `words`; returns
// the first one. The word before it is overwritten too.
std::uint16_t* encode_plane(const std::uint8_t* symbols, std::size_t count,
                            const SymbolSteps& steps, std::size_t lanes, std::uint32_t* states,
                            std::uint16_t* words) {
  std::size_t lane = (count - 1) % lanes;
  for (std::size_t i = count; i-- > 0;) {
    const SymbolStep& step = steps[symbols[i]];
    std::uint32_t x = states[lane];
    // Branchless: a branch would be mispredicted half of the time.
    const std::uint32_t full = (x >> 20) >= step.frequency;
    words[-1] = static_cast<std::uint16_t>(x);
    words -= full;
    x >>= 16 * full;
    const auto quotient = static_cast<std::uint32_t>((x * step.reciprocal) >> kReciprocalBits);
    states[lane] = x + step.start + quotient * (kRansTotal - step.frequency);
    lane = lane == 0 ? lanes - 1 : lane - 1;
  }
  return words;
}

struct CodedBlock {
  std::array<std::uint32_t, kRansLanes> states;
  std::vector<std::uint16_t> words;
};

// `scratch`: one word per symbol, plus one.
CodedBlock encode_block(std::span<const RansPlane> planes, const std::vector<SymbolSteps>& steps,
                        std::size_t first, std::size_t count, std::span<std::uint16_t> scratch) {
  CodedBlock block;
  block.states.fill(kRansLow);
  std::uint16_t* const end = scratch.data() + scratch.size();
  std::uint16_t* words = end;
  for (std::size_t p = planes.size(); p-- > 0;) {
    words = encode_plane(planes[p].symbols.data() + first, count, steps[p], rans_lanes(count),
                         block.states.data(), words);
  }
  block.words.assign(words, end);
  return block;
}

}  // namespace

Result<std::vector<std::uint8_t>> rans_encode(std::span<const RansPlane> planes, std::size_t n) {
  if (planes.size() > kRansPlanes) {
    return usage_error("too many planes in a group (expected at most {}, got {})", kRansPlanes,
                       planes.size());
  }
  std::vector<SymbolSteps> steps(planes.size());
  for (std::size_t p = 0; p < planes.size(); ++p) {
    STGS_TRY(check_plane(planes[p], p, n));
    steps[p] = steps_of(*planes[p].table);
  }
  if (planes.empty() || n == 0) return std::vector<std::uint8_t>{};
  std::vector<CodedBlock> blocks(rans_blocks(n));
  constexpr std::size_t kGrain = 2;  // blocks that share scratch memory
  parallel_blocks(std::size_t{0}, blocks.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    std::vector<std::uint16_t> scratch(planes.size() * std::min(n, kRansBlock) + 1);
    for (std::size_t b = begin; b < end; ++b) {
      const std::size_t first = b * kRansBlock;
      blocks[b] =
          encode_block(planes, steps, first, std::min(n - first, kRansBlock), std::span(scratch));
    }
  });
  ByteWriter out;
  for (std::size_t b = 0; b + 1 < blocks.size(); ++b)
    out.u32(static_cast<std::uint32_t>(blocks[b].words.size()));
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const std::size_t lanes = rans_lanes(std::min(n - b * kRansBlock, kRansBlock));
    for (std::size_t lane = 0; lane < lanes; ++lane) out.u32(blocks[b].states[lane]);
    for (const std::uint16_t word : blocks[b].words) out.u16(word);
  }
  return out.take();
}

}  // namespace stgs
