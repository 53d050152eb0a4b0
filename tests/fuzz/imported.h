// SPDX-License-Identifier: Apache-2.0
// Shared by the targets of imported formats.
#pragma once

#include <cmath>

#include "../fixtures/scene_fixture.h"
#include "fuzz_target.h"
#include "stgs/format/interchange.h"

namespace stgs::fuzz {

inline constexpr ReadLimits kImportLimits{20'000, 2 << 20};

// Heap for an import: the limit, the file in memory, and 1 MiB for uncounted allocations, such as
// the header of a PLY, notes and messages.
inline std::uint64_t import_memory(View input) {
  return kImportLimits.max_memory + 2 * input.size() + (1 << 20);
}

// Checks the guarantees of every reader.
inline void check_import(const Result<Scene>& scene) {
  if (!scene.ok()) {
    const StatusCode code = scene.status().code();
    require(code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported,
            "a reader rejects a file only as invalid or unsupported");
    require(!scene.status().message().empty(), "an error has a message");
    return;
  }
  const Gaussians4D& set = scene->gaussians;
  require(set.size() <= kImportLimits.max_primitives, "the limit on primitives holds");
  for (const auto* array : {&set.position, &set.log_scale, &set.rotation, &set.opacity_logit,
                            &set.sh, &set.time, &set.velocity, &set.sigma, &set.radius}) {
    for (const float value : *array) require(std::isfinite(value), "values are finite");
  }
  for (const float sigma : set.sigma) require(sigma > 0.0f, "sigma is positive");
}

}  // namespace stgs::fuzz
