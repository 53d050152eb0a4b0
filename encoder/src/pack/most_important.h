// SPDX-License-Identifier: Apache-2.0
// Leaving out the primitives of a scene that contribute least to images.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs::encoder {

// Returns the indices of the primitives by falling importance, estimated by size if the scene has
// none; of equally important ones the first.
std::vector<std::uint32_t> rank_by_importance(const Scene& scene);

// Returns the scene with the first `count` primitives of the ranking, in their order.
Scene most_important(const Scene& scene, const std::vector<std::uint32_t>& ranked,
                     std::size_t count);

}  // namespace stgs::encoder
