// SPDX-License-Identifier: Apache-2.0
#include "codec/values.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;

std::size_t index_of(Attribute attribute) {
  return static_cast<std::size_t>(attribute);
}

bool has(AttributeBits attributes, Attribute attribute) {
  return (attributes & attribute_bit(attribute)) != 0;
}

}  // namespace

void ProblemCount::report(std::size_t n, IssueNumber number, bool error, std::uint32_t segment,
                          std::uint64_t offset, std::string_view problem,
                          Findings& findings) const {
  if (count == 0) return;
  if (error) {
    findings.error(number, offset, "segment {}: {} in {} of {} primitives (first: {})", segment,
                   problem, count, n, first);
  } else {
    findings.warning(number, offset, "segment {}: {} in {} of {} primitives (first: {})", segment,
                     problem, count, n, first);
  }
}

void PrimitiveChecks::add(const Gaussians4D& set, AttributeBits attributes, std::size_t begin,
                          std::size_t n) {
  for (const Attribute attribute : attributes_of(set.sh_degree)) {
    if (!has(attributes, attribute)) continue;
    const AttributeView<const float> view = view_of(set, attribute);
    const auto components = static_cast<std::size_t>(components_of(attribute));
    values_[index_of(attribute)] += n;
    not_finite_[index_of(attribute)].add(n, begin, [&](std::size_t i) {
      const float* const values = view.data + i * view.stride;
      return !std::all_of(values, values + components, [](float v) { return std::isfinite(v); });
    });
  }
  if (has(attributes, Attribute::kSigma))
    sigma_.add(n, begin, [&](std::size_t i) { return set.sigma[i] <= 0.0f; });
  if (has(attributes, Attribute::kRadius))
    radius_.add(n, begin, [&](std::size_t i) { return set.radius[i] < 0.0f; });
  if (has(attributes, Attribute::kRotation)) {
    rotation_.add(n, begin, [&](std::size_t i) {
      const float* const q = set.rotation.data() + 4 * i;
      return q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f;
    });
  }
}

void PrimitiveChecks::report(std::uint32_t segment, std::uint64_t offset,
                             Findings& findings) const {
  for (std::size_t a = 0; a < kAttributes; ++a) {
    if (not_finite_[a].count == 0) continue;
    not_finite_[a].report(values_[a], N::kNotFinite, true, segment, offset,
                          fmt::format("{} not finite", name_of(static_cast<Attribute>(a))),
                          findings);
  }
  sigma_.report(values_[index_of(Attribute::kSigma)], N::kSigma, true, segment, offset,
                "sigma <= 0", findings);
  radius_.report(values_[index_of(Attribute::kRadius)], N::kRadius, true, segment, offset,
                 "radius < 0", findings);
  rotation_.report(values_[index_of(Attribute::kRotation)], N::kRotation, true, segment, offset,
                   "quaternion of length 0", findings);
}

std::vector<float> parse_importance(std::span<const std::uint8_t> payload, std::uint64_t primitives,
                                    std::uint64_t offset, Findings& findings) {
  if (payload.size() % 4 != 0 || payload.size() / 4 != primitives) {
    findings.error(N::kImportance, offset,
                   "importances have the wrong size ({} bytes for {} primitives)", payload.size(),
                   primitives);
    return {};
  }
  ByteReader in(payload);
  std::vector<float> values(primitives);
  for (float& value : values) {
    value = in.f32();
    if (value >= 0.0f && std::isfinite(value)) continue;
    findings.error(N::kImportance, offset, "invalid importance {}", value);
    return {};
  }
  return values;
}

}  // namespace stgs
