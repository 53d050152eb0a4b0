// SPDX-License-Identifier: Apache-2.0
#include "pack/most_important.h"

#include <algorithm>
#include <numeric>

#include "stgs/format/quantisation.h"

namespace stgs::encoder {

std::vector<std::uint32_t> rank_by_importance(const Scene& scene) {
  double ticks = 0;
  for (const ScenePart& part : scene.parts) ticks += part.end_ticks - part.begin_ticks;
  const std::vector<float> importance =
      scene.importance.empty()
          ? importance_by_size(scene.gaussians, ticks > 0 ? ticks : scene.metadata.frames)
          : scene.importance;
  std::vector<std::uint32_t> ranked(importance.size());
  std::iota(ranked.begin(), ranked.end(), 0u);
  std::sort(ranked.begin(), ranked.end(), [&](std::uint32_t a, std::uint32_t b) {
    return importance[a] != importance[b] ? importance[a] > importance[b] : a < b;
  });
  return ranked;
}

Scene most_important(const Scene& scene, const std::vector<std::uint32_t>& ranked,
                     std::size_t count) {
  std::vector<std::uint32_t> members(
      ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(std::min(count, ranked.size())));
  std::sort(members.begin(), members.end());
  Scene out;
  out.metadata = scene.metadata;
  out.quantisation = scene.quantisation;
  out.gaussians = scene.gaussians.gather(members);
  if (!scene.importance.empty()) {
    out.importance.reserve(members.size());
    for (const std::uint32_t i : members) out.importance.push_back(scene.importance[i]);
  }
  auto first = members.begin();
  std::uint64_t end = 0;
  for (ScenePart part : scene.parts) {
    end += part.primitives;
    const auto last = std::lower_bound(first, members.end(), end);
    part.primitives = static_cast<std::uint64_t>(last - first);
    first = last;
    out.parts.push_back(part);
  }
  return out;
}

}  // namespace stgs::encoder
