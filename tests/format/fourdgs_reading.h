// SPDX-License-Identifier: Apache-2.0
// Reading of the files of fourdgs_fixture.h.
#pragma once

#include <algorithm>
#include <cmath>

#include "catch.h"
#include "fixtures/fourdgs_fixture.h"
#include "stgs/format/fourdgs.h"
#include "stgs/format/math/lifespan.h"

namespace stgs::testing::fourdgs {

inline Result<Scene> read(const std::string& bytes, ConversionNotes* notes = nullptr,
                          FourdgsReport* report = nullptr, const FourdgsSettings& settings = {},
                          const ReadLimits& limits = {}) {
  const auto source = memory_source({bytes.begin(), bytes.end()}, "clip.4dgs");
  return read_4dgs(*source, settings, limits, report, notes);
}

inline Scene read_valid(const std::string& bytes, ConversionNotes* notes = nullptr) {
  Result<Scene> scene = read(bytes, notes);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  return std::move(*scene);
}

inline std::string error_of(const std::string& bytes, StatusCode code = StatusCode::kInvalidFile) {
  const Result<Scene> scene = read(bytes);
  REQUIRE_FALSE(scene.ok());
  CHECK(scene.status().code() == code);
  return scene.status().message();
}

inline float visibility(const Gaussians4D& set, std::size_t i, double ticks) {
  return math::visibility(static_cast<float>(ticks) - set.time[i], set.sigma[i], set.radius[i]);
}

inline double coordinate(const Gaussians4D& set, std::size_t i, std::size_t axis, double ticks) {
  return set.position[3 * i + axis] + set.velocity[3 * i + axis] * (ticks - set.time[i]);
}

inline double opacity(const Gaussians4D& set, std::size_t i) {
  return 1 / (1 + std::exp(-double{set.opacity_logit[i]}));
}

inline bool has_note(const ConversionNotes& notes, const std::string& part) {
  return std::any_of(notes.begin(), notes.end(),
                     [&](const std::string& n) { return n.find(part) != std::string::npos; });
}

// A fade of 1 s around 1 s, moving along x.
inline Gaussian fading() {
  Gaussian g;
  g.position = {2, -4, 6};
  g.scale = {-4, -8, 2};
  g.rotation_index = 1;  // of x y z w
  g.rotation = {4, 0, -2};
  g.colour = {10, 4, -10};
  g.opacity = 15;
  g.motion = {8, 0, -4};
  g.time = 20;
  return g;
}

}  // namespace stgs::testing::fourdgs
