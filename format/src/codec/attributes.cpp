// SPDX-License-Identifier: Apache-2.0
#include "codec/attributes.h"

#include <array>

namespace stgs {
namespace {

struct Row {
  Attribute attribute;
  const char* name;
  int components;
};
constexpr std::array<Row, 13> kRows = {{{Attribute::kPosition, "position", 3},
                                        {Attribute::kTime, "time", 1},
                                        {Attribute::kSigma, "sigma", 1},
                                        {Attribute::kRadius, "radius", 1},
                                        {Attribute::kVelocity, "velocity", 3},
                                        {Attribute::kLogScale, "log_scale", 3},
                                        {Attribute::kRotation, "rotation", 4},
                                        {Attribute::kOpacity, "opacity", 1},
                                        {Attribute::kSh0, "sh0", 3},
                                        {Attribute::kShDegree, "sh_degree", 1},
                                        {Attribute::kSh1, "sh1", 9},
                                        {Attribute::kSh2, "sh2", 15},
                                        {Attribute::kSh3, "sh3", 21}}};

constexpr std::size_t kBaseStreams = 9;  // of a record without SH above degree 0

constexpr std::array<Attribute, 13> kStreams = [] {
  std::array<Attribute, 13> order{};
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = kRows[i].attribute;
  return order;
}();
constexpr std::array<Attribute, 12> kAttributes = [] {
  std::array<Attribute, 12> order{};
  std::size_t count = 0;
  for (const Row& row : kRows) {
    if (row.attribute != Attribute::kShDegree) order[count++] = row.attribute;
  }
  return order;
}();

const Row& row_of(Attribute attribute) {
  return kRows[static_cast<std::size_t>(attribute) - 1];
}

template <typename Float, typename Set>
AttributeView<Float> view(Set& set, Attribute attribute) {
  const auto sh_stride = static_cast<std::size_t>(3 * set.sh_coefficients());
  // Adding an offset to the null pointer of an empty array is undefined.
  const auto sh = [&set](std::size_t first) {
    return set.sh.empty() ? nullptr : set.sh.data() + first;
  };
  switch (attribute) {
    case Attribute::kPosition:
      return {set.position.data(), 3};
    case Attribute::kTime:
      return {set.time.data(), 1};
    case Attribute::kSigma:
      return {set.sigma.data(), 1};
    case Attribute::kRadius:
      return {set.radius.data(), 1};
    case Attribute::kVelocity:
      return {set.velocity.data(), 3};
    case Attribute::kLogScale:
      return {set.log_scale.data(), 3};
    case Attribute::kRotation:
      return {set.rotation.data(), 4};
    case Attribute::kOpacity:
      return {set.opacity_logit.data(), 1};
    case Attribute::kSh0:
      return {sh(0), sh_stride};
    case Attribute::kShDegree:
      return {};
    case Attribute::kSh1:
      return {sh(3), sh_stride};
    case Attribute::kSh2:
      return {sh(12), sh_stride};
    case Attribute::kSh3:
      return {sh(27), sh_stride};
  }
  return {};
}

}  // namespace

std::span<const Attribute> attributes_of(int sh_degree) {
  return std::span(kAttributes).first(kBaseStreams + static_cast<std::size_t>(sh_degree));
}
std::span<const Attribute> streams_of(int sh_degree) {
  const auto degree = static_cast<std::size_t>(sh_degree);
  return std::span(kStreams).first(kBaseStreams + (degree == 0 ? 0 : 1 + degree));
}
const char* name_of(Attribute attribute) {
  return row_of(attribute).name;
}
int components_of(Attribute attribute) {
  return row_of(attribute).components;
}
void resize_attributes(Gaussians4D& set, AttributeBits attributes, std::size_t n) {
  const auto resize = [&](FloatArray& array, Attribute attribute, int components) {
    const bool used = (attributes & attribute_bit(attribute)) != 0;
    array =
        unset_floats(used ? static_cast<std::size_t>(components) * n : 0, array.get_allocator());
  };
  resize(set.position, Attribute::kPosition, 3);
  resize(set.time, Attribute::kTime, 1);
  resize(set.sigma, Attribute::kSigma, 1);
  resize(set.radius, Attribute::kRadius, 1);
  resize(set.velocity, Attribute::kVelocity, 3);
  resize(set.log_scale, Attribute::kLogScale, 3);
  resize(set.rotation, Attribute::kRotation, 4);
  resize(set.opacity_logit, Attribute::kOpacity, 1);
  resize(set.sh, Attribute::kSh0, 3 * set.sh_coefficients());
}
AttributeView<const float> view_of(const Gaussians4D& set, Attribute attribute) {
  return view<const float>(set, attribute);
}
AttributeView<float> view_of(Gaussians4D& set, Attribute attribute) {
  return view<float>(set, attribute);
}

}  // namespace stgs
