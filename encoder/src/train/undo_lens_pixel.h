// SPDX-License-Identifier: Apache-2.0
// A pixel of undo_lens.h, for the CPU and CUDA.
#pragma once

#include <cstddef>
#include <cstdint>

#include "math/lens.h"

namespace stgs::encoder {

// The bilinear sample of a channel at a position, and the factor that undoes the vignetting there.
struct LensSample {
  std::size_t at[4];  // pixels: upper left, upper right, lower left, lower right
  float right, down;  // weights
  float factor;
};

// Returns the sample for pixel (x, y) of the result.
STGS_FN LensSample lens_sample(math::PinholeCamera camera, math::Lens lens, int x, int y) {
  math::Vec2 pixel;
  pixel.x = static_cast<float>(x) + 0.5f;
  pixel.y = static_cast<float>(y) + 0.5f;
  const math::Vec2 seen = math::through_lens(camera, lens, pixel);
  const float u = math::clamped(seen.x - 0.5f, 0.0f, camera.width - 1.0f);
  const float v = math::clamped(seen.y - 0.5f, 0.0f, camera.height - 1.0f);
  const int x0 = static_cast<int>(u), y0 = static_cast<int>(v);
  const int x1 = x0 + 1 < static_cast<int>(camera.width) ? x0 + 1 : x0;
  const int y1 = y0 + 1 < static_cast<int>(camera.height) ? y0 + 1 : y0;
  const std::size_t width = static_cast<std::size_t>(camera.width);
  LensSample out;
  out.at[0] = y0 * width + x0;
  out.at[1] = y0 * width + x1;
  out.at[2] = y1 * width + x0;
  out.at[3] = y1 * width + x1;
  out.right = u - static_cast<float>(x0);
  out.down = v - static_cast<float>(y0);
  math::Vec2 inside;
  inside.x = u + 0.5f;
  inside.y = v + 0.5f;
  out.factor = 1.0f / (1.0f + lens.vignetting * math::lens_radius2(camera, inside));
  return out;
}

// Returns channel c of that sample of an RGB image, rounded.
STGS_FN std::uint8_t sampled(const std::uint8_t* image, const LensSample& s, int c) {
  const float upper = (1.0f - s.right) * image[3 * s.at[0] + c] + s.right * image[3 * s.at[1] + c];
  const float lower = (1.0f - s.right) * image[3 * s.at[2] + c] + s.right * image[3 * s.at[3] + c];
  const float value = s.factor * ((1.0f - s.down) * upper + s.down * lower);
  return static_cast<std::uint8_t>(math::clamped(value + 0.5f, 0.0f, 255.0f));
}

}  // namespace stgs::encoder
