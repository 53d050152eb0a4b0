// SPDX-License-Identifier: Apache-2.0
#include "train/set_growth.h"

#include <algorithm>
#include <cmath>

namespace stgs::encoder {

std::vector<std::uint32_t> choose_joining(const std::vector<std::uint32_t>& candidates,
                                          std::size_t stored, std::span<const float> importance,
                                          const RecordedSpan& since_set) {
  const auto count = static_cast<double>(candidates.size()), size = static_cast<double>(stored);
  if (stored == 0 || count > kChangedShare * size) return candidates;
  if (since_set.begin < kSettleSeconds) {
    if (count >= kJoinShare * size) return candidates;
    return {};
  }
  const bool is_due =
      std::floor(since_set.begin / kLateInterval) != std::floor(since_set.end / kLateInterval);
  if (!is_due) return {};
  const std::size_t most = std::min(candidates.size(), static_cast<std::size_t>(kLateShare * size));
  std::vector<std::uint32_t> out = candidates;
  if (!importance.empty()) {
    std::stable_sort(out.begin(), out.end(), [&](std::uint32_t a, std::uint32_t b) {
      return importance[a] > importance[b];
    });
  }
  out.resize(most);
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace stgs::encoder
