// SPDX-License-Identifier: Apache-2.0
// What the targets of imported formats share.
#pragma once

#include <cmath>

#include "../api/scene_fixture.h"
#include "fuzz_target.h"
#include "stgs/format/interchange.h"

namespace stgs::fuzz {

inline constexpr ReadLimits kImportLimits{20'000, 512 << 10};

// The file, what is decoded of it, the set twice (what can be drawn is gathered), and buffers.
inline std::uint64_t import_memory(View input) {
  return 4 * kImportLimits.max_memory + 8 * input.size() + (512 << 10);
}

// What every reader promises of a scene that it gives.
inline void check_import(const Result<Scene>& scene) {
  if (!scene.ok()) {
    const StatusCode code = scene.status().code();
    require(code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported,
            "an error is one of the file");
    require(!scene.status().message().empty(), "an error says what is wrong");
    return;
  }
  const Gaussians4D& set = scene->gaussians;
  require(set.size() <= kImportLimits.max_primitives, "the limit of primitives holds");
  for (const auto* array : {&set.position, &set.log_scale, &set.rotation, &set.opacity_logit,
                            &set.sh, &set.time, &set.velocity, &set.sigma, &set.radius}) {
    for (const float value : *array) require(std::isfinite(value), "values are numbers");
  }
  for (const float sigma : set.sigma) require(sigma > 0.0f, "sigma is above 0");
}

}  // namespace stgs::fuzz
