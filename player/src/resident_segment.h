// SPDX-License-Identifier: Apache-2.0
// A decoded segment, and the primitives of it that are visible at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <memory_resource>
#include <string>
#include <vector>

#include "stgs/format/gaussian4d.h"
#include "stgs/format/status.h"

namespace stgs::player {

// A decoded segment with the support of each primitive, [begin, end] in ticks that count as
// `set.time`. Scanning the supports of all active segments takes time proportional to the active
// primitives, because the primitives of a lifespan segment are active for a large part of its span.
struct ResidentSegment {
  ResidentSegment() = default;
  // `memory`, if given, owns the allocations of `decoded`.
  explicit ResidentSegment(Gaussians4D decoded,
                           std::shared_ptr<std::pmr::memory_resource> memory = nullptr);

  // Returns the primitives whose opacity at `ticks`, which count as `set.time`, reaches the
  // rendering threshold, within a rounding error, ascending.
  void find_candidates(float ticks, std::vector<std::uint32_t>& candidates) const;

  std::shared_ptr<std::pmr::memory_resource> owner;  // first, since it must outlive the arrays
  Gaussians4D set;
  FloatArray begin, end;  // allocated like those of `set`
};

// The result of decoding a segment, in host memory.
using DecodedSegment = std::shared_ptr<const ResidentSegment>;

// Returns the bytes of a decoded segment of n primitives, including a list of candidates.
std::uint64_t decoded_segment_bytes(std::uint64_t n, int sh_degree);

// Returns the error for a time whose decoded segments take `bytes` together, more than `budget`.
Status over_budget_error(const std::string& name, double seconds, std::uint64_t bytes,
                         std::uint64_t budget);

}  // namespace stgs::player
