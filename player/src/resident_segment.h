// SPDX-License-Identifier: Apache-2.0
// A decoded segment, and which of its primitives can be seen at a moment.
#pragma once

#include <cstdint>
#include <memory>
#include <memory_resource>
#include <string>
#include <vector>

#include "stgs/format/gaussian4d.h"
#include "stgs/format/status.h"

namespace stgs::player {

// With the support of each primitive, [begin, end] in ticks of its part. Scanning all supports of
// the segments alive is proportional to what is alive: a lifespan segment holds only primitives
// that live for a good part of its span.
struct ResidentSegment {
  ResidentSegment() = default;
  // `memory`, where given, is who owns what `decoded` was allocated from.
  explicit ResidentSegment(Gaussians4D decoded,
                           std::shared_ptr<std::pmr::memory_resource> memory = nullptr);

  // Every primitive whose opacity at a moment of the part reaches the drawing threshold (a rounding
  // error's width beyond included), ascending.
  void find_candidates(float ticks, std::vector<std::uint32_t>& candidates) const;

  std::shared_ptr<std::pmr::memory_resource> owner;  // outlives the rest
  Gaussians4D set;
  FloatArray begin, end;  // from where the set's are
};

// Bytes that a segment of n primitives takes once decoded, a list of candidates included.
std::uint64_t decoded_segment_bytes(std::uint64_t n, int sh_degree);

// Of a moment whose segments, decoded, are more bytes together than the budget.
Status over_budget(const std::string& name, double seconds, std::uint64_t together,
                   std::uint64_t budget);

}  // namespace stgs::player
