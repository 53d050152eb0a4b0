// SPDX-License-Identifier: Apache-2.0
#include "codec/sh_members.h"

#include <algorithm>

namespace stgs {
namespace {

std::uint32_t degree_at(const StreamRow& row, std::span<const Plane> planes, std::size_t i) {
  std::uint32_t degree = 0;
  int shift = 0;
  for (std::size_t d = 0; d < planes.size(); shift += row.digit_bits[d++])
    degree |= std::uint32_t{planes[d].symbols ? planes[d].symbols[i] : planes[d].only} << shift;
  return degree;
}

// Returns those of `count` candidates, candidate(0), candidate(1)..., whose degree is at least
// `least`: `found` of them.
template <typename Candidate>
std::vector<std::uint32_t> select(std::span<const std::uint8_t> degrees, std::uint32_t least,
                                  std::size_t count, std::size_t found,
                                  const Candidate& candidate) {
  std::vector<std::uint32_t> out(found + 1);  // each is written, and kept by the next index
  std::size_t kept = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint32_t i = candidate(k);
    out[kept] = i;
    kept += degrees[i] >= least ? 1 : 0;
  }
  out.pop_back();
  return out;
}

}  // namespace

ShDegrees::ShDegrees(const StreamRow& row, std::span<const Plane> planes, std::uint32_t n) {
  if (planes.size() == 1 && planes[0].symbols != nullptr) {
    degrees_ = {planes[0].symbols, n};
    std::uint8_t greatest = 0;
    for (const std::uint8_t degree : degrees_) greatest = std::max(greatest, degree);
    greatest_ = greatest;
    return;
  }
  combined_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t degree = degree_at(row, planes, i);
    combined_[i] = static_cast<std::uint8_t>(std::min(255u, degree));
    greatest_ = std::max(greatest_, degree);
  }
  degrees_ = combined_;
}

std::array<std::size_t, kShBands> ShDegrees::counts() const {
  std::array<std::size_t, kShBands> out;
  for (std::uint32_t k = 0; k < kShBands; ++k) {
    out[k] = static_cast<std::size_t>(
        std::count_if(degrees_.begin(), degrees_.end(), [k](std::uint8_t own) { return own > k; }));
  }
  return out;
}

ShMembers ShDegrees::members() const {
  ShMembers out;
  const std::array<std::size_t, kShBands> found = counts();
  out[0] = select(degrees_, 1, degrees_.size(), found[0],
                  [](std::size_t i) { return static_cast<std::uint32_t>(i); });
  for (std::uint32_t k = 1; k < kShBands; ++k) {
    const std::vector<std::uint32_t>& before = out[k - 1];
    out[k] = select(degrees_, k + 1, before.size(), found[k],
                    [&before](std::size_t i) { return before[i]; });
  }
  return out;
}

}  // namespace stgs
