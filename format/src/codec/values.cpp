// SPDX-License-Identifier: Apache-2.0
#include "codec/values.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;

bool all_finite(const FloatArray& values) {
  std::uint32_t bad = 0;
  for (float v : values) {
    bad |= (std::bit_cast<std::uint32_t>(v) & 0x7F800000u) == 0x7F800000u ? 1u : 0u;
  }
  return bad == 0;
}

// Reports one finding per attribute.
void check_finite(const Gaussians4D& set, std::uint32_t segment, std::uint64_t offset,
                  Findings& findings) {
  for (Attribute attribute : attributes_of(set.sh_degree)) {
    const AttributeView<const float> view = view_of(set, attribute);
    const auto components = static_cast<std::size_t>(components_of(attribute));
    std::size_t bad = 0, first = 0;
    for (std::size_t i = 0; i < set.size(); ++i) {
      bool finite = true;
      for (std::size_t c = 0; c < components; ++c) {
        finite &= std::isfinite(view.data[i * view.stride + c]);
      }
      if (!finite && bad++ == 0) first = i;
    }
    if (bad > 0) {
      findings.error(N::kNotFinite, offset,
                     "segment {}: {} not finite in {} of {} primitives (first: {})", segment,
                     name_of(attribute), bad, set.size(), first);
    }
  }
}

}  // namespace

void check_primitives(const Gaussians4D& set, std::uint32_t segment, std::uint64_t offset,
                      Findings& findings) {
  const std::size_t n = set.size();
  const FloatArray* arrays[] = {&set.position,      &set.log_scale, &set.rotation,
                                &set.opacity_logit, &set.sh,        &set.time,
                                &set.velocity,      &set.sigma,     &set.radius};
  if (!std::all_of(std::begin(arrays), std::end(arrays),
                   [](const auto* array) { return all_finite(*array); })) {
    check_finite(set, segment, offset, findings);
  }
  check_each(n, N::kSigma, true, segment, offset, "sigma <= 0", findings,
             [&](std::size_t i) { return set.sigma[i] <= 0.0f; });
  check_each(n, N::kRadius, true, segment, offset, "radius < 0", findings,
             [&](std::size_t i) { return set.radius[i] < 0.0f; });
  check_each(n, N::kRotation, true, segment, offset, "quaternion of length 0", findings,
             [&](std::size_t i) {
               const float* q = set.rotation.data() + 4 * i;
               return q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f;
             });
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
