// SPDX-License-Identifier: Apache-2.0
// The renderer that the renderer_*_cases.cpp compare with the CPU renderer; the test program of
// each device provides it.
#pragma once

#include <cstdint>
#include <memory>

#include "stgs/player/renderer.h"

namespace stgs::testing {

struct UnderTest {
  bool variant = false;         // another code path of the backend, with the same bits
  std::uint64_t instances = 0;  // initial capacity for splats and tile instances; 0: default
};

Result<std::unique_ptr<player::Renderer>> make_renderer_under_test(const UnderTest& settings);

}  // namespace stgs::testing
