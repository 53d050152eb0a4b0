// SPDX-License-Identifier: Apache-2.0
#include "train/changed_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "stgs/format/parallel.h"
#include "train/ray_probe.h"

namespace stgs::encoder {
namespace {

// Differences are averaged over so many pixels around each, because single ones match by chance.
constexpr int kRadius = 2;
// A pixel has changed if its excess is above this, and above this multiple of a quantile of the
// excesses of its view.
constexpr float kMinDifference = 0.03f;
constexpr double kQuantile = 0.75;
constexpr float kQuantileFactor = 3.0f;
constexpr float kStaticDifference = 0.012f;  // between frames
constexpr int kSpacing = 2;                  // between pixels that get a point
constexpr int kMinPixels = 12;               // of a change in a view

// Returns the mean difference of the channels per pixel.
std::vector<float> differences(const Image& a, const Image& b) {
  const std::size_t pixels = static_cast<std::size_t>(a.width) * static_cast<std::size_t>(a.height);
  std::vector<float> out(pixels, 0.0f);
  for (int c = 0; c < 3; ++c) {
    for (std::size_t p = 0; p < pixels; ++p)
      out[p] += std::abs(a.plane(c)[p] - b.plane(c)[p]) * (1.0f / 3.0f);
  }
  return out;
}

// Returns the mean over kRadius pixels around each, fewer at the border.
std::vector<float> averaged(const std::vector<float>& values, int width, int height) {
  std::vector<float> rows(values.size()), out(values.size());
  const auto average = [](const float* from, float* to, int count, int stride) {
    float sum = 0;
    for (int i = 0; i < std::min(kRadius, count); ++i) sum += from[i * stride];
    for (int i = 0; i < count; ++i) {
      if (i + kRadius < count) sum += from[(i + kRadius) * stride];
      if (i > kRadius) sum -= from[(i - kRadius - 1) * stride];
      const int first = std::max(i - kRadius, 0), last = std::min(i + kRadius, count - 1);
      to[i * stride] = sum / static_cast<float>(last - first + 1);
    }
  };
  for (int y = 0; y < height; ++y)
    average(&values[static_cast<std::size_t>(y) * width],
            &rows[static_cast<std::size_t>(y) * width], width, 1);
  for (int x = 0; x < width; ++x) average(&rows[x], &out[x], height, width);
  return out;
}

// Returns the differences of a rendering from an image, averaged.
std::vector<float> residual_of(const SetView& shown, const Image& image) {
  return averaged(differences(shown.colour, image), image.width, image.height);
}

ViewChange find_view_change(const SetView& shown, const Image& image, const Residual& usual) {
  ViewChange out;
  if (image.data.empty()) return out;
  out.excess = residual_of(shown, image);
  for (std::size_t p = 0; p < out.excess.size(); ++p)
    out.excess[p] -= static_cast<float>(usual[p]) / 255.0f;
  std::vector<float> sorted = out.excess;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(
                                           kQuantile * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), middle, sorted.end());
  out.limit = std::max(kMinDifference, kQuantileFactor * *middle);
  return out;
}

using Mask = std::vector<std::uint8_t>;  // 0 or 1

bool has_changes(const Mask& mask) {
  return std::count(mask.begin(), mask.end(), 1) >= kMinPixels;
}

Mask mask_of(const ViewChange& change) {
  Mask out(change.excess.size());
  for (std::size_t p = 0; p < out.size(); ++p) out[p] = change.has_changed(p) ? 1 : 0;
  return out;
}

// Removes pixels whose images differ between frames.
void remove_moving(const Image& image, const Image& earlier, Mask& mask) {
  if (mask.empty() || earlier.data.empty()) return;
  const std::vector<float> moved = averaged(differences(image, earlier), image.width, image.height);
  for (std::size_t p = 0; p < mask.size(); ++p)
    if (moved[p] > kStaticDifference) mask[p] = 0;
}

// A point, and the distance of its neighbours in the image.
struct FoundPoint {
  InitialPoint point;
  float spacing;
};

// Returns the points of a view that the probe finds.
std::vector<FoundPoint> points_of(const SetViews& views, std::size_t v, const SetView& shown,
                                  const Image& image, const Mask& mask, const RayProbe& probe) {
  const math::PinholeCamera& camera = views.camera(v);
  std::vector<FoundPoint> out;
  for (int y = kSpacing / 2; y < image.height; y += kSpacing) {
    for (int x = kSpacing / 2; x < image.width; x += kSpacing) {
      const std::size_t pixel = static_cast<std::size_t>(y) * image.width + x;
      if (mask[pixel] == 0) continue;
      const float depth = probe.depth(v, x, y, shown.depth.data[pixel]);
      if (depth == 0) continue;
      FoundPoint found{};
      const math::Vec3 position =
          to_world(camera, static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, depth);
      std::copy_n(&position.x, 3, found.point.position);
      for (int c = 0; c < 3; ++c) {
        const float value = std::clamp(255.0f * image.plane(c)[pixel], 0.0f, 255.0f);
        found.point.colour[c] = static_cast<std::uint8_t>(std::lround(value));
      }
      found.point.frame = -1;
      found.spacing = kSpacing * depth / camera.fx;
      out.push_back(found);
    }
  }
  return out;
}

// Returns at most `limit` points, without those near earlier ones.
std::vector<InitialPoint> without_repeats(const std::vector<std::vector<FoundPoint>>& views,
                                          std::size_t limit) {
  std::set<std::array<int, 3>> taken;
  std::vector<InitialPoint> all;
  for (const std::vector<FoundPoint>& points : views) {
    for (const FoundPoint& found : points) {
      std::array<int, 3> cell{};
      for (std::size_t c = 0; c < 3; ++c)
        cell[c] = static_cast<int>(std::floor(found.point.position[c] / found.spacing));
      if (taken.insert(cell).second) all.push_back(found.point);
    }
  }
  if (all.size() <= limit) return all;
  std::vector<InitialPoint> out;
  for (std::size_t k = 0; k < limit; ++k) out.push_back(all[k * all.size() / limit]);
  return out;
}

}  // namespace

void update_residuals(const std::vector<SetView>& shown, const std::vector<Image>& images,
                      std::vector<Residual>& residuals) {
  residuals.resize(shown.size());
  parallel_for(std::size_t{0}, shown.size(), [&](std::size_t v) {
    if (images[v].data.empty()) return;
    const std::vector<float> found = residual_of(shown[v], images[v]);
    residuals[v].resize(found.size(), 255);
    for (std::size_t p = 0; p < found.size(); ++p) {
      const float value = std::min(std::ceil(255.0f * found[p]), 255.0f);
      residuals[v][p] = std::min(residuals[v][p], static_cast<std::uint8_t>(value));
    }
  });
}

std::vector<ViewChange> find_view_changes(const std::vector<SetView>& shown,
                                          const std::vector<Image>& images,
                                          const std::vector<Residual>& residuals) {
  std::vector<ViewChange> out(shown.size());
  parallel_for(std::size_t{0}, shown.size(), [&](std::size_t v) {
    if (!residuals[v].empty()) out[v] = find_view_change(shown[v], images[v], residuals[v]);
  });
  return out;
}

Result<std::vector<InitialPoint>> find_changed_points(const SetViews& views,
                                                      const std::vector<SetView>& shown,
                                                      const std::vector<Image>& images,
                                                      const std::vector<ViewChange>& changes,
                                                      int first, int last, std::size_t limit) {
  std::vector<Mask> changed;
  for (const ViewChange& change : changes) changed.push_back(mask_of(change));
  if (std::none_of(changed.begin(), changed.end(), has_changes)) return std::vector<InitialPoint>();
  for (const int frame : {first, (first + last) / 2}) {
    STGS_ASSIGN(const std::vector<Image> earlier, views.images(frame));
    for (std::size_t v = 0; v < views.size(); ++v) remove_moving(images[v], earlier[v], changed[v]);
  }
  const RayProbe probe(views, images, shown);
  std::vector<std::vector<FoundPoint>> found(views.size());
  parallel_for(std::size_t{0}, views.size(), [&](std::size_t v) {
    if (has_changes(changed[v]))
      found[v] = points_of(views, v, shown[v], images[v], changed[v], probe);
  });
  return without_repeats(found, limit);
}

}  // namespace stgs::encoder
