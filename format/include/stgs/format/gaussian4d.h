// SPDX-License-Identifier: Apache-2.0
// A set of 4D Gaussian primitives as a structure of arrays (spec/representation.md, 1).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory_resource>
#include <vector>

#include "stgs/format/float_array.h"

namespace stgs {

// The duration of one tick, as a fraction of a second. For a trainer a tick is one captured frame.
struct TimeBase {
  std::uint32_t numerator = 1;
  std::uint32_t denominator = 30;

  // Converts ticks to seconds.
  double seconds(double ticks) const { return ticks * numerator / denominator; }
  // Converts seconds to ticks. Snaps to a whole tick within rounding error, so that the time of a
  // frame maps back to exactly that frame.
  double ticks(double seconds) const;
  bool operator==(const TimeBase&) const = default;
};

// Returns the duration of a frame at `fps` > 0. Rates become integers, NTSC rates (29.97 means
// 30000/1001) or multiples of 1/1000 fps.
TimeBase frame_time_of(double fps);

// From where the times of decoded primitives count.
enum class TimeOrigin {
  kPart,   // the beginning of their part
  kRecord  // a time of their record, which leaves them their precision in a long part (spec 8.9)
};

// N primitives. Each array stores all components of one primitive before those of the next.
struct Gaussians4D {
  int sh_degree = 0;         // 0..3
  FloatArray position;       // N x 3, at time `time`; scene units
  FloatArray log_scale;      // N x 3, natural log of the standard deviations
  FloatArray rotation;       // N x 4, quaternion w x y z of any nonzero length
  FloatArray opacity_logit;  // N
  FloatArray sh;             // N x (sh_degree+1)^2 x 3, coefficient then channel
  FloatArray time;           // N, centre T; ticks from `time_origin`
  FloatArray velocity;       // N x 3, effective velocity u = v / f; scene units per tick
  FloatArray sigma;          // N, > 0; ticks
  FloatArray radius;         // N, >= 0; ticks
  // From where `time` counts, ticks from the beginning of the part. 0 unless TimeOrigin::kRecord
  // was requested; writers accept no other value.
  double time_origin = 0;

  // Creates an empty set in heap memory.
  Gaussians4D() = default;
  // Creates an empty set that allocates from `memory`, which must outlive it. Sets moved from it
  // allocate from there too; copies use the heap.
  explicit Gaussians4D(std::pmr::memory_resource* memory);

  // Returns N.
  std::size_t size() const { return opacity_logit.size(); }
  // Returns the number of SH coefficients per channel.
  int sh_coefficients() const { return (sh_degree + 1) * (sh_degree + 1); }
  // Sets N. New primitives are zero in every array.
  void resize(std::size_t n);
  // Allocates memory for N primitives in total.
  void reserve(std::size_t n);
  // Appends primitive i of `other`, which must have the same sh_degree and time_origin.
  void append(const Gaussians4D& other, std::size_t i);
  // Appends all primitives of `other`, which must have the same sh_degree and time_origin.
  void append(const Gaussians4D& other);
  // Returns the listed primitives in that order. Each index must be below size().
  Gaussians4D gather(const std::vector<std::uint32_t>& indices) const;
};

// Receives primitives of a segment in their order: `set` has those from number `begin` on. It is
// valid during the call.
using RangeVisitor = std::function<void(const Gaussians4D& set, std::size_t begin)>;

// Where and when the primitives of a segment are: X at T, scene units, 3 floats each; T, ticks from
// the beginning of the part.
struct Placement {
  FloatArray position, time;
};

}  // namespace stgs
