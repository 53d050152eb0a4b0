// SPDX-License-Identifier: Apache-2.0
// Scenes for measuring renderers, made of a model that has no time.
#pragma once

#include <cstdint>

#include "stgs/format/scene_file.h"

namespace stgs::tools {

// The dynamics of tests/bench/RESULTS.md's comparisons: 300 frames, T uniform in them, sigma 3
// frames for 30 % and 900 for the rest, r nearly 0, speeds to .001 units a frame and axis.
void animate(Scene& scene, std::uint64_t seed);

// Makes of each primitive `lives` that follow each other over 300 frames, the borders between them
// anywhere: what is alive at a moment is what the model had, `lives` times as much is stored.
void part_lives(Scene& scene, int lives, std::uint64_t seed);

// All harmonics to degree 3; those that the model lacks are random.
void fill_harmonics(Gaussians4D& set, std::uint64_t seed);

}  // namespace stgs::tools
