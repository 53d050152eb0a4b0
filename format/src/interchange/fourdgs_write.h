// SPDX-License-Identifier: Apache-2.0
// The Gaussians of a .4dgs file being written.
#pragma once

#include "interchange/fourdgs_format.h"
#include "stgs/format/interchange.h"

namespace stgs::fourdgs {

// A set of Gaussians and the tables that it refers to.
struct CodedScene {
  Grid grid;
  std::vector<Window> windows;
  Population set;
  std::vector<std::uint32_t> source;  // index in the scene of each Gaussian
  std::vector<TickRange> support;     // times at which each may be visible, seconds
  std::array<double, 6> bounds{};
};

// Fits and quantises the primitives of a scene that are visible at some time, in its order. Adds
// notes on errors.
Result<CodedScene> encode_set(const Scene& scene, double duration, ConversionNotes* notes);

}  // namespace stgs::fourdgs
