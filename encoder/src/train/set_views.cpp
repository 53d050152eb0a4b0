// SPDX-License-Identifier: Apache-2.0
#include "train/set_views.h"

#include <algorithm>
#include <array>

#include "stgs/format/parallel.h"
#include "train/camera_refinement.h"
#include "train/colour_correction.h"

namespace stgs::encoder {
namespace {

// Longer side of the images, pixels: live encoding renders and compares all views in milliseconds.
constexpr int kMaxViewSide = 160;

// Returns by how much to reduce a side: a power of two, so that views keep their size if a live
// capture halves its images.
int factor_of(int side) {
  int factor = 1;
  while (side > factor * kMaxViewSide) factor *= 2;
  return factor;
}

// Returns the image with each pixel the mean of factor x factor of them. Incomplete blocks at the
// right and bottom are left out.
Image reduced(const Image8& image, int factor) {
  Image out;
  out.reshape(image.width / factor, image.height / factor, 3);
  const float scale = 1.0f / (255.0f * static_cast<float>(factor * factor));
  std::vector<std::uint32_t> column(std::size_t{3} * out.width * factor);  // sums
  for (int y = 0; y < out.height; ++y) {
    std::fill(column.begin(), column.end(), 0);
    for (int v = y * factor; v < (y + 1) * factor; ++v) {
      const std::uint8_t* row = &image.data[std::size_t{3} * v * image.width];
      for (std::size_t i = 0; i < column.size(); ++i) column[i] += row[i];
    }
    for (int x = 0; x < out.width; ++x) {
      std::uint32_t sum[3] = {0, 0, 0};
      const std::uint32_t* block = &column[std::size_t{3} * x * factor];
      for (int k = 0; k < factor; ++k)
        for (int c = 0; c < 3; ++c) sum[c] += block[3 * k + c];
      for (int c = 0; c < 3; ++c)
        out.plane(c)[y * out.width + x] = scale * static_cast<float>(sum[c]);
    }
  }
  return out;
}

// Adds the three neighbours along an axis, whose ends repeat. `stride` separates neighbours.
void add_neighbours(const float* from, float* to, int count, int stride) {
  for (int i = 0; i < count; ++i) {
    const int before = std::max(i - 1, 0), after = std::min(i + 1, count - 1);
    to[i * stride] = from[before * stride] + from[i * stride] + from[after * stride];
  }
}

// Returns the mean of 3 x 3 pixels: renderings and images differ at edges by a part of a pixel.
Image blurred(const Image& image) {
  Image rows = image, out = image;
  for (int c = 0; c < image.channels; ++c) {
    for (int y = 0; y < image.height; ++y) {
      const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y) * image.width;
      add_neighbours(image.plane(c) + row, rows.plane(c) + row, image.width, 1);
    }
    for (int x = 0; x < image.width; ++x)
      add_neighbours(rows.plane(c) + x, out.plane(c) + x, image.height, image.width);
  }
  for (float& value : out.data) value *= 1.0f / 9.0f;
  return out;
}

}  // namespace

SetViews::SetViews(const PreparedCapture& capture, const TrainState& state, int kernel)
    : capture_(capture),
      state_(state),
      kernel_(kernel),
      full_(with_refined_cameras(capture, state).training_cameras()) {
  for (const Camera& camera : full_) {
    const int factor = factor_of(std::max(camera.width, camera.height));
    math::PinholeCamera small = camera.pinhole(capture.near_plane);
    for (float* value : {&small.fx, &small.fy, &small.cx, &small.cy})
      *value /= static_cast<float>(factor);
    small.width = static_cast<float>(camera.width / factor);
    small.height = static_cast<float>(camera.height / factor);
    factors_.push_back(factor);
    cameras_.push_back(small);
  }
}

Result<Image> SetViews::image(std::size_t view, int frame) const {
  const Camera& camera = full_[view];
  if (!has_frame(capture_, camera, frame)) return Image();
  STGS_ASSIGN(const auto image, load_shared_frame(capture_, camera, frame));
  return blurred(reduced(*image, factors_[view]));
}

Result<std::vector<Image>> SetViews::images(int frame) const {
  std::vector<Image> out(size());
  std::vector<Status> statuses(size());
  parallel_for(std::size_t{0}, size(), [&](std::size_t v) {
    Result<Image> image = this->image(v, frame);
    if (image.ok())
      out[v] = std::move(*image);
    else
      statuses[v] = image.status();
  });
  for (const Status& status : statuses) STGS_TRY(status);
  return out;
}

std::vector<SetView> SetViews::render(const Gaussians4D& set) const {
  std::vector<SetView> out(size());
  RasterSettings settings;
  settings.background = state_.background;
  settings.kernel = kernel_;
  parallel_for(std::size_t{0}, size(), [&](std::size_t v) {
    SplatFrame frame;
    RasterOutput rendered;
    stgs::render(set, 0, cameras_[v], settings, frame, rendered);
    Image corrected;
    apply_colour(state_.colour[v], rendered.colour, corrected);
    out[v] = {blurred(corrected), std::move(rendered.depth), std::move(rendered.alpha)};
  });
  return out;
}

std::ptrdiff_t pixel_of(const math::PinholeCamera& camera, const math::Vec3& p) {
  if (p.z <= camera.near_plane) return -1;
  const float u = camera.fx * p.x / p.z + camera.cx, v = camera.fy * p.y / p.z + camera.cy;
  if (!(u >= 0 && v >= 0 && u < camera.width && v < camera.height)) return -1;
  return static_cast<std::ptrdiff_t>(v) * static_cast<std::ptrdiff_t>(camera.width) +
         static_cast<std::ptrdiff_t>(u);
}

math::Vec3 to_world(const math::PinholeCamera& camera, float u, float v, float depth) {
  const math::Vec3 c{(u - camera.cx) / camera.fx * depth - camera.translation.x,
                     (v - camera.cy) / camera.fy * depth - camera.translation.y,
                     depth - camera.translation.z};
  return math::mat3_transpose_mul(camera.rotation, c);
}

}  // namespace stgs::encoder
