// SPDX-License-Identifier: Apache-2.0
// Mapping of planes to floats on the vector unit. All machines give the same floats.
#pragma once

#include <cstddef>
#include <cstdint>

#include "codec/stream.h"

namespace stgs {

// Primitives mapped for all streams in turn: their values fit the second-level cache.
inline constexpr std::size_t kMapRun = 512;

// Integers of a run of primitives on which later streams depend.
struct MapRun {
  // SH rows of the run that are not in the cache yet. They are fetched while other attributes are
  // mapped, because storing them takes as long as their memory does.
  const float *sh = nullptr, *sh_end = nullptr;
  std::uint32_t sigma[kMapRun] = {}, radius[kMapRun] = {};  // bits b (spec 8.6)
  std::uint32_t spread[kMapRun] = {};                       // of the log scales (spec 8.8)
};

// Maps the values [begin, end) of a stream, at most kMapRun; `begin` is a multiple of 64. `carry`:
// for predictions that depend on the previous value, the value of each component before `begin`;
// updated to that before `end`. `run`: of the same primitives, from the streams before. Returns
// false if an integer is out of range.
bool map_task(const StreamTask& task, const SegmentContext& context, std::size_t begin,
              std::size_t end, std::uint32_t* carry, MapRun& run, Gaussians4D& set);
// Adds the differences of the values [begin, end), with kDelta or kMorton, to `sums` by component.
void sum_task(const StreamTask& task, std::size_t begin, std::size_t end, std::uint32_t* sums);
// Returns whether check_primitives() accepts these attributes of primitives [begin, end).
// `floats`: those stored as floats; only these can fail to be finite.
bool all_renderable(const Gaussians4D& set, std::uint32_t attributes, std::uint32_t floats,
                    std::size_t begin, std::size_t end);

}  // namespace stgs
