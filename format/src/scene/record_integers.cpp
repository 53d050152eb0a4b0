// SPDX-License-Identifier: Apache-2.0
#include "scene/record_integers.h"

#include <algorithm>
#include <bit>

namespace stgs {
namespace {

Integers float_bits(const Gaussians4D& set, Attribute attribute) {
  Integers out;
  out.attribute = attribute;
  out.components = components_of(attribute);
  out.values.reserve(set.size() * static_cast<std::size_t>(out.components));
  const AttributeView<const float> view = view_of(set, attribute);
  for (std::size_t c = 0; c < static_cast<std::size_t>(out.components); ++c) {
    for (std::size_t i = 0; i < set.size(); ++i) {
      out.values.push_back(std::bit_cast<std::uint32_t>(view.data[i * view.stride + c]));
    }
  }
  return out;
}

// Reduces an array to these primitives.
void keep_members(Integers& integers, const std::vector<std::uint32_t>& members) {
  const std::size_t n = integers.size();
  std::vector<std::uint32_t> out;
  out.reserve(members.size() * static_cast<std::size_t>(integers.components));
  for (std::size_t c = 0; c < static_cast<std::size_t>(integers.components); ++c) {
    for (const std::uint32_t i : members) out.push_back(integers.values[c * n + i]);
  }
  integers.values = std::move(out);
}

}  // namespace

std::vector<Integers> lossless_integers(const Gaussians4D& set) {
  std::vector<Integers> out;
  for (Attribute attribute : attributes_of(set.sh_degree))
    out.push_back(float_bits(set, attribute));
  return out;
}

void add_sh_degrees(std::vector<Integers>& integers) {
  const auto first = std::find_if(integers.begin(), integers.end(),
                                  [](const Integers& a) { return band_of(a.attribute) > 0; });
  if (first == integers.end()) return;
  const std::size_t n = integers.front().size();
  Integers degrees;
  degrees.attribute = Attribute::kShDegree;
  degrees.mapping = Mapping::kInteger;
  degrees.components = 1;
  degrees.values.resize(n);
  for (auto band = first; band != integers.end(); ++band) {
    for (std::size_t k = 0; k < band->values.size(); ++k) {
      if (band->values[k] != 0)
        degrees.values[k % n] = static_cast<std::uint32_t>(band_of(band->attribute));
    }
  }
  for (auto band = first; band != integers.end(); ++band) {
    std::vector<std::uint32_t> members;
    for (std::uint32_t i = 0; i < n; ++i) {
      if (degrees.values[i] >= static_cast<std::uint32_t>(band_of(band->attribute)))
        members.push_back(i);
    }
    keep_members(*band, members);
  }
  integers.insert(first, std::move(degrees));
}

}  // namespace stgs
