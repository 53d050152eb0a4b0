// SPDX-License-Identifier: Apache-2.0
#include "half_size.h"

namespace stgs::encoder {

Image8 half_size(const Image8& image) {
  Image8 half;
  half.width = image.width / 2;
  half.height = image.height / 2;
  half.channels = image.channels;
  half.data.resize(std::size_t{1} * half.width * half.height * half.channels);
  const std::size_t row = std::size_t{1} * image.width * image.channels;
  for (int y = 0; y < half.height; ++y) {
    for (int x = 0; x < half.width; ++x) {
      for (int c = 0; c < image.channels; ++c) {
        const std::uint8_t* p = &image.data[2 * y * row + (2 * x) * image.channels + c];
        const int sum = p[0] + p[image.channels] + p[row] + p[row + image.channels];
        half.data[(std::size_t{1} * y * half.width + x) * half.channels + c] =
            static_cast<std::uint8_t>((sum + 2) / 4);
      }
    }
  }
  return half;
}

Camera half_size(const Camera& camera) {
  Camera half = camera;
  half.width = camera.width / 2;
  half.height = camera.height / 2;
  // Pixel centres are at +0.5, so all intrinsics are halved.
  for (double* value : {&half.fx, &half.fy, &half.cx, &half.cy}) *value *= 0.5;
  return half;
}

}  // namespace stgs::encoder
