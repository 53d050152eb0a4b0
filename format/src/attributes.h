// SPDX-License-Identifier: Apache-2.0
// The attributes of a primitive as the file numbers them (spec 6.3).
#pragma once

#include <cstdint>
#include <span>

#include "stgs/format/coded_segment.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// The attributes of a set of this harmonic degree, in file order.
std::span<const Attribute> attributes_of(int sh_degree);
const char* name_of(Attribute attribute);
int components_of(Attribute attribute);

// Component c of primitive i is data[i * stride + c].
template <typename Float>
struct AttributeView {
  Float* data = nullptr;
  std::size_t stride = 0;
};
AttributeView<const float> view_of(const Gaussians4D& set, Attribute attribute);
AttributeView<float> view_of(Gaussians4D& set, Attribute attribute);

}  // namespace stgs
