// SPDX-License-Identifier: Apache-2.0
#include "quantise/integers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>

#include "quantise/steps.h"

namespace stgs {
namespace {

constexpr int kSortedBits = 21;  // of a position, per axis, in the keys by which they are sorted

Integers begin(Attribute attribute, Mapping mapping, Step step, int components, std::size_t n) {
  Integers out;
  out.attribute = attribute;
  out.mapping = mapping;
  out.step = step;
  out.components = components;
  out.values.resize(n * static_cast<std::size_t>(components));
  return out;
}

// Returns x in steps, clamped so that a mapping can add two of them.
std::uint32_t steps_in(double x, Step step, Mapping mapping) {
  const std::int64_t limit = max_steps(mapping, step.multiplier) / 2;
  return static_cast<std::uint32_t>(std::clamp(nearest(x, step), -limit, limit));
}

}  // namespace

Integers linear_integers(const Gaussians4D& part, Attribute attribute, Mapping mapping, Step step) {
  const int components = components_of(attribute);
  const std::size_t n = part.size();
  const AttributeView<const float> view = view_of(part, attribute);
  Integers out = begin(attribute, mapping, step, components, n);
  for (std::size_t c = 0; c < static_cast<std::size_t>(components); ++c) {
    for (std::size_t i = 0; i < n; ++i) {
      out.values[c * n + i] = steps_in(view.data[i * view.stride + c], step, mapping);
    }
  }
  return out;
}

Integers time_integers(const Gaussians4D& part, Step step, double segment_begin) {
  Integers out = begin(Attribute::kTime, Mapping::kTime, step, 1, part.size());
  const double base = time_base(segment_begin, step);
  for (std::size_t i = 0; i < part.size(); ++i)
    out.values[i] = steps_in(part.time[i] - base, step, Mapping::kTime);
  return out;
}

Integers truncated_integers(const Gaussians4D& part, Attribute attribute, Step step, float offset) {
  const AttributeView<const float> view = view_of(part, attribute);
  Integers out = begin(attribute, Mapping::kTruncated, step, 1, part.size());
  for (std::size_t i = 0; i < part.size(); ++i) {
    out.values[i] = static_cast<std::uint32_t>(truncated_steps(view.data[i] + offset, step));
  }
  out.origin[1] = offset;
  return out;
}

Integers displacement_integers(const Gaussians4D& part, Step step, int part_exponent) {
  const std::size_t n = part.size();
  Integers out = begin(Attribute::kVelocity, Mapping::kDisplacement, step, 3, n);
  for (std::size_t i = 0; i < n; ++i) {
    const int e =
        step.exponent - lifespan_exponent_of(part.sigma[i], part.radius[i], part_exponent);
    const Step own{std::clamp(e, kMinExponent, kMaxExponent), step.multiplier};
    for (std::size_t c = 0; c < 3; ++c) {
      out.values[c * n + i] = steps_in(part.velocity[3 * i + c], own, Mapping::kDisplacement);
    }
  }
  return out;
}

Integers rotation_integers(const Gaussians4D& part, const Integers& log_scales, Step step) {
  const std::size_t n = part.size();
  const std::array<std::uint32_t, 6> bounds = shape_bounds(log_scales.step);
  Integers out = begin(Attribute::kRotation, Mapping::kShapedRotation, step, 3, n);
  for (std::size_t i = 0; i < n; ++i) {
    const float* q = part.rotation.data() + 4 * i;
    const auto scale = [&](std::size_t c) {
      return static_cast<std::int32_t>(log_scales.values[c * n + i]);
    };
    const auto spread = static_cast<std::uint32_t>(std::max({scale(0), scale(1), scale(2)}) -
                                                   std::min({scale(0), scale(1), scale(2)}));
    const Step own{std::clamp(step.exponent + rotation_shift(bounds, spread), kMinRotationExponent,
                              kMaxRotationExponent),
                   step.multiplier};
    for (std::size_t c = 0; c < 3; ++c) {
      out.values[c * n + i] = static_cast<std::uint32_t>(nearest(q[c + 1], own));
    }
  }
  return out;
}

Integers colour_integers(const Gaussians4D& part, Attribute attribute, Step step) {
  const auto components = static_cast<std::size_t>(components_of(attribute));
  const std::size_t n = part.size();
  const AttributeView<const float> view = view_of(part, attribute);
  Integers out = begin(attribute, Mapping::kColour, step, static_cast<int>(components), n);
  for (std::size_t c = 0; c < components; c += 3) {
    for (std::size_t i = 0; i < n; ++i) {
      const float* channel = view.data + i * view.stride + c;
      const double r = channel[0], g = channel[1], b = channel[2];
      const double planes[3] = {0.25 * (r + 2.0 * g + b), 0.5 * (r - b), 0.25 * (2.0 * g - r - b)};
      for (std::size_t k = 0; k < 3; ++k) {
        out.values[(c + k) * n + i] = steps_in(planes[k], step, Mapping::kColour);
      }
    }
  }
  return out;
}

Integers position_integers(const Gaussians4D& part, Step step, const float (&origin)[3], int bits,
                           std::vector<std::uint32_t>& order) {
  const std::size_t n = part.size();
  Integers out = begin(Attribute::kPosition, Mapping::kLinear, step, 3, n);
  out.morton = true;
  std::copy_n(origin, 3, out.origin);
  std::vector<std::uint64_t> keys(n);
  std::vector<std::array<std::uint32_t, 3>> positions(n);
  std::uint32_t all = 0;
  for (std::size_t i = 0; i < n; ++i) {
    std::array<std::uint32_t, 3>& q = positions[i];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double from_origin =
          static_cast<double>(part.position[3 * i + axis]) - out.origin[axis];
      q[axis] = static_cast<std::uint32_t>(
          std::clamp<std::int64_t>(nearest(from_origin, out.step), 0, (1 << bits) - 1));
      all |= q[axis];
    }
  }
  // The bits left out are below those of the file's keys, which have fewer bits.
  const int left_out = std::max(0, static_cast<int>(std::bit_width(all)) - kSortedBits);
  for (std::size_t i = 0; i < n; ++i) {
    const std::array<std::uint32_t, 3>& q = positions[i];
    keys[i] = morton_key(q[0] >> left_out, q[1] >> left_out, q[2] >> left_out);
  }
  order.resize(n);
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&keys](std::uint32_t a, std::uint32_t b) {
    return keys[a] != keys[b] ? keys[a] < keys[b] : a < b;
  });
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t axis = 0; axis < 3; ++axis)
      out.values[axis * n + k] = positions[order[k]][axis];
  }
  return out;
}

}  // namespace stgs
