// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace stgs::encoder {

// Rows of an image that one task of a loss computes.
inline constexpr int kLossRows = 8;

}  // namespace stgs::encoder
