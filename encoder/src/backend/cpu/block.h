// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace stgs::encoder::cpu {

// Primitives or splats of one task of the CPU backend.
inline constexpr std::size_t kBlock = 512;

}  // namespace stgs::encoder::cpu
