// SPDX-License-Identifier: Apache-2.0
#include "train/normal_loss.h"

#include <algorithm>
#include <cstdlib>
#include <numeric>

#include "math/grad.h"
#include "stgs/format/parallel.h"
#include "train/loss_rows.h"

namespace stgs::encoder {
namespace {

using math::Plane;
using math::Vec3;

// Minimum rows per task.

template <typename Work>
void for_each_row(int first_row, int end_row, Work work) {
  parallel_blocks(first_row, end_row, kLossRows, [&](int first, int last) {
    for (int y = first; y < last; ++y) work(y);
  });
}

Plane blended_plane(const RasterOutput& surface, std::size_t p) {
  const Image& normal = surface.colour;
  return {{normal.plane(0)[p], normal.plane(1)[p], normal.plane(2)[p]},
          surface.depth.data[p] * surface.alpha.data[p]};
}

Vec3 ray_of(const math::PinholeCamera& camera, int x, int y) {
  return math::pixel_ray(camera, static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
}

}  // namespace

int image_difference(const Image8& image, int x, int y) {
  const std::size_t row = std::size_t{3} * image.width;
  const std::uint8_t* p = image.data.data() + row * y + std::size_t{3} * x;
  int across = 0, down = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    across += std::abs(int{p[c + 3]} - int{*(p + c - 3)});
    down += std::abs(int{p[c + row]} - int{*(p + c - row)});
  }
  return std::max(across, down);
}

void NormalLoss::compute_differences(const Image8& ground_truth) {
  for_each_row(1, height_ - 1, [&](int y) {
    std::uint16_t* row = difference_.data() + static_cast<std::size_t>(y) * width_;
    for (int x = 1; x < width_ - 1; ++x)
      row[x] = static_cast<std::uint16_t>(image_difference(ground_truth, x, y));
    const auto [min, max] = std::minmax_element(row + 1, row + width_ - 1);
    row_min_[y] = *min;
    row_max_[y] = *max;
  });
  min_difference_ = *std::min_element(row_min_.begin() + 1, row_min_.end() - 1);
  max_difference_ = *std::max_element(row_max_.begin() + 1, row_max_.end() - 1);
}

void NormalLoss::evaluate_row(const RasterOutput& surface, const math::PinholeCamera& camera,
                              float scale, int y, Image& d_surface) {
  const float unit = max_difference_ > min_difference_
                         ? 1.0f / static_cast<float>(max_difference_ - min_difference_)
                         : 0.0f;
  for (int x = 1; x < width_ - 1; ++x) {
    const std::size_t p = static_cast<std::size_t>(y) * width_ + x;
    const std::size_t above = p - width_, below = p + width_;
    if (!(depth_[p] > 0 && depth_[above] > 0 && depth_[below] > 0 && depth_[p - 1] > 0 &&
          depth_[p + 1] > 0))
      continue;
    const auto point = [&](int px, int py, std::size_t at) {
      return math::vec3_scale(ray_of(camera, px, py), depth_[at]);
    };
    const auto minus = [](Vec3 a, Vec3 b) { return Vec3{a.x - b.x, a.y - b.y, a.z - b.z}; };
    const Vec3 down = minus(point(x, y + 1, below), point(x, y - 1, above));
    const Vec3 right = minus(point(x + 1, y, p + 1), point(x - 1, y, p - 1));
    const float gradient = static_cast<float>(difference_[p] - min_difference_) * unit;
    const math::NormalTerm term =
        math::normal_term(blended_plane(surface, p).normal, surface.alpha.data[p], down, right,
                          math::flatness_weight(gradient));
    row_sum_[y] += term.value;
    d_surface.plane(0)[p] = scale * term.normal.x;
    d_surface.plane(1)[p] = scale * term.normal.y;
    d_surface.plane(2)[p] = scale * term.normal.z;
    by_down_[p] = math::vec3_scale(term.down, scale);
    by_right_[p] = math::vec3_scale(term.right, scale);
  }
}

// Accumulates the gradients of each pixel's depth from the terms of its neighbours.
void NormalLoss::gather_row(const RasterOutput& surface, const math::PinholeCamera& camera, int y,
                            Image& d_surface) const {
  for (int x = 0; x < width_; ++x) {
    const std::size_t p = static_cast<std::size_t>(y) * width_ + x;
    if (!(depth_[p] > 0)) continue;
    Vec3 by_point{0.0f, 0.0f, 0.0f};
    if (y > 0) by_point = math::vec3_add(by_point, by_down_[p - width_]);
    if (y + 1 < height_)
      by_point = math::vec3_add(by_point, math::vec3_scale(by_down_[p + width_], -1.0f));
    if (x > 0) by_point = math::vec3_add(by_point, by_right_[p - 1]);
    if (x + 1 < width_)
      by_point = math::vec3_add(by_point, math::vec3_scale(by_right_[p + 1], -1.0f));
    const Vec3 ray = ray_of(camera, x, y);
    const Plane by = math::plane_depth_grad(blended_plane(surface, p), depth_[p], ray,
                                            math::dot3(by_point, ray));
    d_surface.plane(0)[p] += by.normal.x;
    d_surface.plane(1)[p] += by.normal.y;
    d_surface.plane(2)[p] += by.normal.z;
    d_surface.plane(3)[p] = by.distance;
  }
}

double NormalLoss::evaluate(const RasterOutput& surface, const Image8& ground_truth,
                            const math::PinholeCamera& camera, float weight, Image& d_surface) {
  width_ = surface.alpha.width;
  height_ = surface.alpha.height;
  d_surface.reshape(width_, height_, 4);
  std::fill(d_surface.data.begin(), d_surface.data.end(), 0.0f);
  if (width_ < 3 || height_ < 3) return 0.0;
  const std::size_t pixels = static_cast<std::size_t>(width_) * height_;
  depth_.resize(pixels);
  by_down_.assign(pixels, {0.0f, 0.0f, 0.0f});
  by_right_.assign(pixels, {0.0f, 0.0f, 0.0f});
  difference_.resize(pixels);
  row_min_.resize(height_);
  row_max_.resize(height_);
  row_sum_.assign(height_, 0.0);
  compute_differences(ground_truth);
  for_each_row(0, height_, [&](int y) {
    for (int x = 0; x < width_; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * width_ + x;
      depth_[p] =
          math::plane_depth(blended_plane(surface, p), surface.alpha.data[p], ray_of(camera, x, y));
    }
  });
  const float scale = weight / static_cast<float>(pixels);
  for_each_row(1, height_ - 1, [&](int y) { evaluate_row(surface, camera, scale, y, d_surface); });
  for_each_row(0, height_, [&](int y) { gather_row(surface, camera, y, d_surface); });
  return std::accumulate(row_sum_.begin(), row_sum_.end(), 0.0) / static_cast<double>(pixels);
}

}  // namespace stgs::encoder
