// SPDX-License-Identifier: Apache-2.0
#include "train/colour_correction.h"

#include <vector>

#include "stgs/format/parallel.h"
#include "train/adam.h"

namespace stgs::encoder {
namespace {

constexpr int kRowBlock = 16;  // rows per partial sum; fixes the order of summation

int row_blocks(const Image& image) {
  return (image.height + kRowBlock - 1) / kRowBlock;
}

template <typename Visit>
void for_row_blocks(const Image& image, Visit visit) {
  parallel_for(0, row_blocks(image), [&](int block) {
    const std::size_t first = std::size_t{1} * block * kRowBlock * image.width;
    const std::size_t rows = std::min(kRowBlock, image.height - block * kRowBlock);
    visit(block, first, first + rows * image.width);
  });
}

}  // namespace

void apply_colour(const ColourMap& m, const Image& colour, Image& corrected) {
  corrected.reshape(colour.width, colour.height, 3);
  for_row_blocks(colour, [&](int, std::size_t begin, std::size_t end) {
    const float* r = colour.plane(0);
    const float* g = colour.plane(1);
    const float* b = colour.plane(2);
    for (int c = 0; c < 3; ++c) {
      float* out = corrected.plane(c);
      for (std::size_t i = begin; i < end; ++i) {
        out[i] = m[3 * c] * r[i] + m[3 * c + 1] * g[i] + m[3 * c + 2] * b[i] + m[9 + c];
      }
    }
  });
}

ColourMap colour_backward(const ColourMap& m, const Image& colour, Image& d_corrected,
                          const UnmappedBackground* unmapped) {
  std::vector<ColourMap> partial(row_blocks(colour), ColourMap{});
  for_row_blocks(colour, [&](int block, std::size_t begin, std::size_t end) {
    ColourMap& sum = partial[block];
    for (int c = 0; c < 3; ++c) {
      const float* d = d_corrected.plane(c);
      for (int k = 0; k < 3; ++k) {
        const float* source = colour.plane(k);
        float total = 0.0f;
        for (std::size_t i = begin; i < end; ++i) total += d[i] * source[i];
        sum[3 * c + k] = total;
      }
      for (std::size_t i = begin; i < end; ++i) sum[9 + c] += d[i];
      if (unmapped == nullptr) continue;
      float behind = 0.0f;
      for (std::size_t i = begin; i < end; ++i) behind += d[i] * unmapped->transmittance.data[i];
      sum[3 * c] -= behind * unmapped->colour.x;
      sum[3 * c + 1] -= behind * unmapped->colour.y;
      sum[3 * c + 2] -= behind * unmapped->colour.z;
      sum[9 + c] -= behind;
    }
    float* dr = d_corrected.plane(0);
    float* dg = d_corrected.plane(1);
    float* db = d_corrected.plane(2);
    for (std::size_t i = begin; i < end; ++i) {
      const float r = m[0] * dr[i] + m[3] * dg[i] + m[6] * db[i];
      const float g = m[1] * dr[i] + m[4] * dg[i] + m[7] * db[i];
      const float b = m[2] * dr[i] + m[5] * dg[i] + m[8] * db[i];
      dr[i] = r;
      dg[i] = g;
      db[i] = b;
    }
  });
  ColourMap gradient{};
  for (const ColourMap& sum : partial) {
    for (std::size_t i = 0; i < gradient.size(); ++i) gradient[i] += sum[i];
  }
  return gradient;
}

void update_colour(TrainState& state, std::size_t index, const ColourMap& gradient, float rate) {
  const AdamCorrection correction(++state.colour_updates[index]);
  adam_step(state.colour[index].data(), state.colour_first[index].data(),
            state.colour_second[index].data(), gradient.data(), gradient.size(), rate, correction);
  const auto cameras = static_cast<float>(state.colour.size());
  for (std::size_t i = 0; i < kIdentityColour.size(); ++i) {
    float mean = 0.0f;
    for (const ColourMap& map : state.colour) mean += map[i];
    const float excess = mean / cameras - kIdentityColour[i];
    for (ColourMap& map : state.colour) map[i] -= excess;
  }
}

}  // namespace stgs::encoder
