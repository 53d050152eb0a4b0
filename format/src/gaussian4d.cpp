// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/gaussian4d.h"

#include <utility>

namespace stgs {
namespace {

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

void Gaussians4D::resize(std::size_t n) {
  for_each_attribute(*this, *this, [n](auto& array, auto&, int components) {
    array.resize(n * static_cast<std::size_t>(components), 0.0f);
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
  for_each_attribute(out, *this, [&indices](auto& to, const auto& from, int components) {
    to.reserve(indices.size() * static_cast<std::size_t>(components));
    for (std::uint32_t i : indices) {
      const auto first = from.begin() + static_cast<std::ptrdiff_t>(i) * components;
      to.insert(to.end(), first, first + components);
    }
  });
  return out;
}

}  // namespace stgs
