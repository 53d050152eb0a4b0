// SPDX-License-Identifier: Apache-2.0
#include "train/undo_lens.h"

#include <vector>

#include "stgs/format/parallel.h"
#include "train/undo_lens_pixel.h"

namespace stgs::encoder {

void undo_lens(const Image8& image, const math::PinholeCamera& camera, const math::Lens& lens,
               Image8& out) {
  out.width = image.width;
  out.height = image.height;
  out.channels = 3;
  out.data.resize(image.data.size());
  parallel_for(0, image.height, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      const LensSample sample = lens_sample(camera, lens, x, y);
      std::uint8_t* const to = out.data.data() + 3 * (std::size_t{1} * y * image.width + x);
      for (int c = 0; c < 3; ++c) to[c] = sampled(image.data.data(), sample, c);
    }
  });
}

float vignetting_gradient(const math::PinholeCamera& camera, const Image& colour,
                          const Image& d_colour) {
  std::vector<double> rows(static_cast<std::size_t>(colour.height));
  parallel_for(0, colour.height, [&](int y) {
    double sum = 0;
    for (int x = 0; x < colour.width; ++x) {
      const std::size_t at = std::size_t{1} * y * colour.width + x;
      float along = 0.0f;
      for (int c = 0; c < 3; ++c) along += colour.plane(c)[at] * d_colour.plane(c)[at];
      const math::Vec2 pixel{static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f};
      sum += along * math::lens_radius2(camera, pixel);
    }
    rows[static_cast<std::size_t>(y)] = sum;
  });
  double total = 0;
  for (const double row : rows) total += row;
  return static_cast<float>(total);
}

}  // namespace stgs::encoder
