// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/gaussian4d.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "stgs/format/parallel.h"

namespace stgs {
namespace {

// Iterates over floats without values.
struct UnsetIterator {
  using iterator_category = std::random_access_iterator_tag;
  using value_type = UnsetFloat;
  using difference_type = std::ptrdiff_t;
  using pointer = void;
  using reference = UnsetFloat;

  std::ptrdiff_t at = 0;

  UnsetFloat operator*() const { return {}; }
  UnsetIterator& operator++() {
    ++at;
    return *this;
  }
  friend std::ptrdiff_t operator-(UnsetIterator a, UnsetIterator b) { return a.at - b.at; }
  bool operator==(const UnsetIterator&) const = default;
};

// Calls visit(array of a, array of b, components) for every attribute of two sets.
template <typename A, typename B, typename Visit>
void for_each_attribute(A& a, B& b, Visit visit) {
  visit(a.position, b.position, 3);
  visit(a.log_scale, b.log_scale, 3);
  visit(a.rotation, b.rotation, 4);
  visit(a.opacity_logit, b.opacity_logit, 1);
  visit(a.sh, b.sh, 3 * a.sh_coefficients());
  visit(a.time, b.time, 1);
  visit(a.velocity, b.velocity, 3);
  visit(a.sigma, b.sigma, 1);
  visit(a.radius, b.radius, 1);
}

}  // namespace

FloatArray unset_floats(std::size_t size, const FloatAllocator& allocator) {
  const UnsetIterator end{static_cast<std::ptrdiff_t>(size)};
  return FloatArray(UnsetIterator(), end, allocator);
}

Gaussians4D::Gaussians4D(std::pmr::memory_resource* memory)
    : position(memory),
      log_scale(memory),
      rotation(memory),
      opacity_logit(memory),
      sh(memory),
      time(memory),
      velocity(memory),
      sigma(memory),
      radius(memory) {}

double TimeBase::ticks(double seconds) const {
  const double exact = seconds * denominator / numerator, whole = std::round(exact);
  // Tolerates a few roundings, here and where the caller computed the seconds.
  const double tolerance = std::min(1e-12 * std::abs(whole), 1e-4);
  return std::abs(exact - whole) <= tolerance ? whole : exact;
}

TimeBase frame_time_of(double fps) {
  const auto whole = [](double v) { return v >= 0.5 && std::abs(v - std::round(v)) < 0.005; };
  if (whole(fps)) return {1, static_cast<std::uint32_t>(std::lround(fps))};
  if (whole(fps * 1.001))
    return {1001, static_cast<std::uint32_t>(std::lround(fps * 1.001)) * 1000};
  return {1000, static_cast<std::uint32_t>(std::max(1L, std::lround(fps * 1000)))};
}

void Gaussians4D::resize(std::size_t n) {
  for_each_attribute(*this, *this, [n](auto& array, auto&, int components) {
    array.resize(n * static_cast<std::size_t>(components), 0.0f);
  });
}

void Gaussians4D::reserve(std::size_t n) {
  for_each_attribute(*this, *this, [n](auto& array, auto&, int components) {
    array.reserve(n * static_cast<std::size_t>(components));
  });
}

void Gaussians4D::append(const Gaussians4D& other) {
  for_each_attribute(*this, other, [](auto& to, const auto& from, int) {
    to.insert(to.end(), from.begin(), from.end());
  });
}

void Gaussians4D::append(const Gaussians4D& other, std::size_t i) {
  for_each_attribute(*this, other, [i](auto& to, const auto& from, int components) {
    const auto first = from.begin() + static_cast<std::ptrdiff_t>(i) * components;
    to.insert(to.end(), first, first + components);
  });
}

Gaussians4D Gaussians4D::gather(const std::vector<std::uint32_t>& indices) const {
  Gaussians4D out;
  out.sh_degree = sh_degree;
  out.time_origin = time_origin;
  for_each_attribute(out, *this, [&indices](auto& to, const auto& from, int components) {
    gather_rows(from, static_cast<std::size_t>(components), indices, to);
  });
  return out;
}

}  // namespace stgs
