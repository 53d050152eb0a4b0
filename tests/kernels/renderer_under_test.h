// SPDX-License-Identifier: Apache-2.0
// The renderer that renderer_cases.cpp compares with the CPU's; each device's test makes its own.
#pragma once

#include <cstdint>
#include <memory>

#include "stgs/player/renderer.h"

namespace stgs::testing {

struct UnderTest {
  bool variant = false;         // the backend's other way to the same bits
  std::uint64_t instances = 0;  // room for splats, and in tiles, at first; 0: the backend's choice
};

Result<std::unique_ptr<player::Renderer>> make_renderer_under_test(const UnderTest& settings);

}  // namespace stgs::testing
