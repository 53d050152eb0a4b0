// SPDX-License-Identifier: Apache-2.0
// The streams of a record as numbered in files (spec 6.3).
#pragma once

#include <cstdint>
#include <span>

#include "stgs/format/coded_segment.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// Returns the attributes of a set of this SH degree, in file order.
std::span<const Attribute> attributes_of(int sh_degree);
// Returns the streams of a record of all attributes: these and, above degree 0, kShDegree.
std::span<const Attribute> streams_of(int sh_degree);
// Returns the degree of the SH of an attribute, 0 for other attributes.
constexpr int band_of(Attribute attribute) {
  return attribute < Attribute::kSh1
             ? 0
             : 1 + static_cast<int>(attribute) - static_cast<int>(Attribute::kSh1);
}
// Returns the name of an attribute in messages and reports: "position", "sh0"...
const char* name_of(Attribute attribute);
// Returns the number of floats per primitive.
int components_of(Attribute attribute);

// A set of attributes, one bit each.
using AttributeBits = std::uint32_t;
constexpr AttributeBits attribute_bit(Attribute attribute) {
  return 1u << static_cast<int>(attribute);
}
inline constexpr AttributeBits kAllAttributes = 0xFFFFFFFF;
// Where and when primitives are: position and time. Ends change both of a primitive, and need its
// motion for that.
inline constexpr AttributeBits kPlacement =
    attribute_bit(Attribute::kPosition) | attribute_bit(Attribute::kTime);
inline constexpr AttributeBits kEndedPlacement = kPlacement | attribute_bit(Attribute::kSigma) |
                                                 attribute_bit(Attribute::kRadius) |
                                                 attribute_bit(Attribute::kVelocity);
// Sets the size of these attributes of a set, whose values are then to be written, and empties the
// others.
void resize_attributes(Gaussians4D& set, AttributeBits attributes, std::size_t n);

// An attribute of a set: component c of primitive i is data[i * stride + c].
template <typename Float>
struct AttributeView {
  Float* data = nullptr;
  std::size_t stride = 0;
};
AttributeView<const float> view_of(const Gaussians4D& set, Attribute attribute);
AttributeView<float> view_of(Gaussians4D& set, Attribute attribute);

}  // namespace stgs
