// SPDX-License-Identifier: Apache-2.0
#include "resident_segment.h"

#include <cmath>
#include <utility>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/parallel.h"

namespace stgs::player {

ResidentSegment::ResidentSegment(Gaussians4D decoded,
                                 std::shared_ptr<std::pmr::memory_resource> memory)
    : owner(std::move(memory)),
      set(std::move(decoded)),
      begin(set.time.get_allocator()),
      end(set.time.get_allocator()) {
  begin.resize(set.size());
  end.resize(set.size());
  constexpr std::size_t kBlock = 4096;
  parallel_blocks(std::size_t{0}, set.size(), kBlock, [this](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      const math::Support support =
          math::candidate_support(math::opacity_of(set.opacity_logit[i]), set.time[i], set.sigma[i],
                                  set.radius[i], math::kAlphaThreshold);
      begin[i] = support.begin;
      end[i] = support.end;
    }
  });
}

void ResidentSegment::find_candidates(float ticks, std::vector<std::uint32_t>& candidates) const {
  candidates.resize(begin.size());
  std::size_t n = 0;
  for (std::size_t i = 0; i < begin.size(); ++i) {
    candidates[n] = static_cast<std::uint32_t>(i);
    // Without a branch: neither condition is predictable.
    n += static_cast<std::size_t>(begin[i] <= ticks) & static_cast<std::size_t>(ticks <= end[i]);
  }
  candidates.resize(n);
}

std::uint64_t decoded_segment_bytes(std::uint64_t n, int sh_degree) {
  const auto coefficients = static_cast<std::uint64_t>((sh_degree + 1) * (sh_degree + 1));
  const std::uint64_t floats = 3 + 3 + 4 + 1 + 3 * coefficients + 1 + 3 + 1 + 1;
  return n * (floats * sizeof(float) + 2 * sizeof(float) + sizeof(std::uint32_t));
}

Status over_budget_error(const std::string& name, double seconds, std::uint64_t bytes,
                         std::uint64_t budget) {
  // Rounded so that the requested amount suffices.
  constexpr double kTenth = 0x1p20 / 10;
  return {StatusCode::kLimit,
          fmt::format("{}: the segments active at {:.6g} s take {:.1f} MiB decoded, more than the "
                      "budget of {:.1f} MiB; allow more memory",
                      name, seconds, std::ceil(static_cast<double>(bytes) / kTenth) / 10,
                      std::floor(static_cast<double>(budget) / kTenth) / 10)};
}

}  // namespace stgs::player
