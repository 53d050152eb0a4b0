// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/encoder/image_file.h"

namespace stgs::tools {

// Encodes an image as PNG. Throws std::bad_alloc.
std::vector<std::uint8_t> encode_png(const encoder::Image8& image);

}  // namespace stgs::tools
