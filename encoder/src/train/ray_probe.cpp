// SPDX-License-Identifier: Apache-2.0
#include "train/ray_probe.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "stgs/format/math/project.h"

namespace stgs::encoder {
namespace {

constexpr std::size_t kPartners = 4;
constexpr float kMinDepthAlpha = 0.5f;  // of content with a depth
// The depths that are considered, over those of the renderings.
constexpr float kNearestShare = 0.5f, kFarthestShare = 1.05f;
constexpr int kDepths = 64;  // evenly spaced in inverse depth
constexpr int kReach = 2;    // pixels between samples around the pixel
constexpr float kMaxProbeCost = 0.06f;
constexpr float kDistinct = 0.7f;  // of the median cost: a depth is determined below it
constexpr float kSimilar = 0.01f;  // costs that differ by less are equal

math::Vec3 centre_of(const math::PinholeCamera& camera) {
  return math::vec3_scale(math::mat3_transpose_mul(camera.rotation, camera.translation), -1.0f);
}

}  // namespace

RayProbe::RayProbe(const SetViews& views, const std::vector<Image>& images,
                   const std::vector<SetView>& shown)
    : views_(views), images_(images) {
  for (const SetView& view : shown) {
    for (std::size_t p = 0; p < view.depth.data.size(); ++p) {
      if (view.alpha.data[p] < kMinDepthAlpha) continue;
      nearest_ = std::min(nearest_, kNearestShare * view.depth.data[p]);
      farthest_ = std::max(farthest_, kFarthestShare * view.depth.data[p]);
    }
  }
  std::vector<math::Vec3> centres;
  for (std::size_t v = 0; v < views.size(); ++v) centres.push_back(centre_of(views.camera(v)));
  for (std::size_t v = 0; v < views.size(); ++v) {
    std::vector<std::pair<float, std::size_t>> others;
    for (std::size_t o = 0; o < views.size(); ++o) {
      if (o == v || images[o].data.empty()) continue;
      others.emplace_back(std::hypot(centres[o].x - centres[v].x, centres[o].y - centres[v].y,
                                     centres[o].z - centres[v].z),
                          o);
    }
    std::sort(others.begin(), others.end());
    others.resize(std::min(others.size(), kPartners));
    std::vector<std::size_t>& partners = partners_.emplace_back();
    for (const auto& [distance, o] : others) partners.push_back(o);
  }
}

float RayProbe::cost(std::size_t view, int x, int y, float depth) const {
  const math::PinholeCamera& camera = views_.camera(view);
  const Image& image = images_[view];
  std::array<float, kPartners> costs{};
  std::size_t seen = 0;
  for (const std::size_t partner : partners_[view]) {
    const Image& other = images_[partner];
    float sum = 0;
    int samples = 0;
    for (int k = 0; k < 9; ++k) {
      const int u = x + kReach * (k % 3 - 1), v = y + kReach * (k / 3 - 1);
      if (u < 0 || v < 0 || u >= image.width || v >= image.height) continue;
      const math::Vec3 world =
          to_world(camera, static_cast<float>(u) + 0.5f, static_cast<float>(v) + 0.5f, depth);
      const std::ptrdiff_t pixel =
          pixel_of(views_.camera(partner), math::to_camera(views_.camera(partner), world));
      if (pixel < 0) continue;
      for (int c = 0; c < 3; ++c)
        sum += std::abs(image.plane(c)[v * image.width + u] - other.plane(c)[pixel]);
      ++samples;
    }
    if (samples >= 5) costs[seen++] = sum / (3.0f * static_cast<float>(samples));
  }
  if (seen < 2) return INFINITY;
  // Some views do not see it: the better half counts.
  std::sort(costs.begin(), costs.begin() + static_cast<std::ptrdiff_t>(seen));
  const std::size_t used = (seen + 1) / 2;
  float sum = 0;
  for (std::size_t k = 0; k < used; ++k) sum += costs[k];
  return sum / static_cast<float>(used);
}

float RayProbe::depth(std::size_t view, int x, int y, float expected) const {
  std::array<float, kDepths> costs{};
  int best = 0;
  const auto depth_of = [&](int k) {
    const float s = static_cast<float>(k) / (kDepths - 1);
    return 1.0f / ((1 - s) / farthest_ + s / nearest_);
  };
  for (int k = 0; k < kDepths; ++k) {
    costs[static_cast<std::size_t>(k)] = cost(view, x, y, depth_of(k));
    if (costs[static_cast<std::size_t>(k)] < costs[static_cast<std::size_t>(best)]) best = k;
  }
  const float least = costs[static_cast<std::size_t>(best)];
  if (!(least <= kMaxProbeCost)) return 0;
  if (expected > 0 && cost(view, x, y, expected) <= least + kSimilar) return expected;
  std::nth_element(costs.begin(), costs.begin() + kDepths / 2, costs.end());
  return least <= kDistinct * costs[kDepths / 2] ? depth_of(best) : 0;
}

}  // namespace stgs::encoder
