// SPDX-License-Identifier: Apache-2.0
// A set of 4D Gaussian primitives, structure of arrays (spec/representation.md, 1).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory_resource>
#include <vector>

namespace stgs {

// Seconds a tick, as a fraction. A trainer's tick is one frame of the capture.
struct TimeBase {
  std::uint32_t numerator = 1;
  std::uint32_t denominator = 30;

  double seconds(double ticks) const { return ticks * numerator / denominator; }
  // Whole where `seconds` is that of a whole tick but for rounding: a frame's time is the frame's.
  double ticks(double seconds) const;
  bool operator==(const TimeBase&) const = default;
};

// The length of a frame at that many frames a second, > 0: rates are whole, NTSC's (29.97 stands
// for 30000/1001), or thousandths.
TimeBase frame_time_of(double fps);

// Components of primitives.
using FloatArray = std::pmr::vector<float>;

// N primitives. Every array holds its components one primitive after the other.
struct Gaussians4D {
  int sh_degree = 0;         // 0..3
  FloatArray position;       // N x 3, at time `time`; scene units
  FloatArray log_scale;      // N x 3, natural log of the standard deviations
  FloatArray rotation;       // N x 4, quaternion w x y z of any length but 0
  FloatArray opacity_logit;  // N
  FloatArray sh;             // N x (sh_degree+1)^2 x 3, coefficient then channel
  FloatArray time;           // N, centre T; ticks from the beginning of its part
  FloatArray velocity;       // N x 3, effective velocity u = v / f; scene units a tick
  FloatArray sigma;          // N, > 0; ticks
  FloatArray radius;         // N, >= 0; ticks

  Gaussians4D() = default;
  // With its memory from there, and that of what it is moved to; copies are on the heap.
  explicit Gaussians4D(std::pmr::memory_resource* memory);

  std::size_t size() const { return opacity_logit.size(); }
  int sh_coefficients() const { return (sh_degree + 1) * (sh_degree + 1); }
  // Sets N; new primitives are zero in every array.
  void resize(std::size_t n);
  // Memory for N in all.
  void reserve(std::size_t n);
  // Appends primitive i of `other`, which has the same sh_degree; all of its primitives.
  void append(const Gaussians4D& other, std::size_t i);
  void append(const Gaussians4D& other);
  // Keeps the primitives listed, in that order; each index < size().
  Gaussians4D gather(const std::vector<std::uint32_t>& indices) const;
};

}  // namespace stgs
