// SPDX-License-Identifier: Apache-2.0
#include "init/carved_depth.h"

#include <algorithm>

namespace stgs::encoder::init {
namespace {

// A point in front of confirmed depth, by this share of it, is wrong.
constexpr double kInFront = 0.04;
constexpr int kSteps = 96;  // of inverse depth that are tried

// Returns the nearest inverse depth that no view contradicts, or the given one.
double carved(const std::vector<Surface>& surfaces, const View& view, int x, int y, double inverse,
              double low, double high) {
  const double step = (high - low) / kSteps;
  for (int k = 0; k < 2 * kSteps; ++k) {
    const double candidate = inverse + (k % 2 == 0 ? -0.5 : 0.5) * (k + k % 2) * step;
    if (candidate < low || candidate > high) continue;
    if (!is_contradicted(surfaces, view.at(x + 0.5, y + 0.5, 1 / candidate))) return candidate;
  }
  return inverse;
}

}  // namespace

bool is_contradicted(const std::vector<Surface>& surfaces, const cv::Vec3d& point) {
  return std::any_of(surfaces.begin(), surfaces.end(), [&point](const Surface& surface) {
    const Pixel p = project(surface.view, point);
    return p.inside && surface.weight.at<float>(p.y(), p.x()) >= kStereoWeight &&
           p.depth < (1 - kInFront) * surface.depth.at<float>(p.y(), p.x());
  });
}

Status carve_depth(double nearest, double farthest, Work& work, std::vector<Surface>* surfaces) {
  std::vector<cv::Mat> depths(surfaces->size());
  STGS_TRY(work.for_each(int(surfaces->size()), [&](int i) -> Status {
    const Surface& surface = (*surfaces)[i];
    depths[i] = surface.depth.clone();
    for (int y = 0; y < depths[i].rows; ++y) {
      for (int x = 0; x < depths[i].cols; ++x) {
        if (surface.weight.at<float>(y, x) > 0) continue;
        float& depth = depths[i].at<float>(y, x);
        depth =
            float(1 / carved(*surfaces, surface.view, x, y, 1 / depth, 1 / farthest, 1 / nearest));
      }
    }
    return {};
  }));
  for (std::size_t i = 0; i < depths.size(); ++i) (*surfaces)[i].depth = depths[i];
  return {};
}

}  // namespace stgs::encoder::init
