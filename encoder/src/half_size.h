// SPDX-License-Identifier: Apache-2.0
// Images and cameras at half the size. An odd last row or column is dropped.
#pragma once

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// Averages 2x2 pixels.
Image8 half_size(const Image8& image);
// Returns the camera of half_size() images.
Camera half_size(const Camera& camera);

}  // namespace stgs::encoder
