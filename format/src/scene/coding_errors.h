// SPDX-License-Identifier: Apache-2.0
// The differences between the primitives of a file and their source (spec 4.7).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "codec/planes.h"
#include "container/segment.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// Maps the planes of a segment as a decoder does. `plans`: of the streams of all its records, in
// order; the records have `planes`. Times count from the beginning of the part.
Gaussians4D map_planes(std::span<const RecordPlanes> planes, std::span<const StreamPlan> plans,
                       int sh_degree, double segment_begin, int part_exponent);

// The differences of all attributes over a number of primitives. Their sums do not depend on the
// number of threads if segments are added in order.
//
// A coded primitive is compared with its source after those changes of the source that leave its
// renders as they are (spec 4.7):
// - The source has the axes, among the 24 of spec 11.7, that are nearest to those of the coded one.
// - Its position is that at the coded T.
// - A T outside the part moves to its end, or to that of the flat top if this is nearer, and the
//   radius shrinks by as much.
// - If the coded primitive is fully visible throughout its part, the source has its T, sigma and
//   radius, and the greatest opacity that it had in the part.
//
// Errors of position and velocity are lengths of a vector, that of rotation is an angle in radians;
// the others are differences of single numbers.
class CodingErrors {
 public:
  // Adds coded primitives and their sources, primitives `members` of `source`, which are in the
  // same part of `part_ticks` ticks.
  void add(const Gaussians4D& source, std::span<const std::uint32_t> members,
           const Gaussians4D& coded, double part_ticks);
  void add(const CodingErrors& other);
  // Returns an entry for each attribute of a set of this SH degree. The greatest differences are
  // rounded up.
  std::vector<ErrorBound> bounds(int sh_degree) const;

 private:
  struct Sum {
    double greatest = 0, squares = 0, count = 0;
    void add(double error);
  };
  Sum& sum_of(Attribute attribute) { return sums_[static_cast<std::size_t>(attribute)]; }
  void add_lifespan(const Gaussians4D& source, std::size_t i, const Gaussians4D& coded,
                    std::size_t k, double part_ticks);
  void add_sh(const Gaussians4D& source, std::span<const std::uint32_t> members,
              const Gaussians4D& coded);

  std::array<Sum, static_cast<std::size_t>(Attribute::kSh3) + 1> sums_{};  // by attribute
};

}  // namespace stgs
