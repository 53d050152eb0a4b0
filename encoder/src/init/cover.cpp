// SPDX-License-Identifier: Apache-2.0
#include "init/cover.h"

#include <algorithm>
#include <cmath>

namespace stgs::encoder::init {
namespace {

// Returns 255 for each block that has a point on the surface.
cv::Mat occupied_blocks(const Surface& surface, int block, double tolerance,
                        const std::vector<SurfacePoint>& points) {
  cv::Mat occupied((surface.view.height + block - 1) / block,
                   (surface.view.width + block - 1) / block, CV_8U, cv::Scalar(0));
  for (const SurfacePoint& point : points) {
    const Pixel p = project(surface.view, point.position);
    if (!p.inside) continue;
    const float depth = surface.depth.at<float>(p.y(), p.x());
    if (depth > 0 && std::abs(1 / depth - 1 / p.depth) > tolerance) continue;
    occupied.at<std::uint8_t>(p.y() / block, p.x() / block) = 255;
  }
  return occupied;
}

// Finds the pixel of the block with the largest weight; among equals, the one nearest to the
// centre. Returns false if no pixel has a weight and a depth.
bool best_pixel(const Surface& surface, cv::Rect block, cv::Point* best) {
  float largest = 0;
  double nearest = 0;
  const cv::Point2d middle(block.x + 0.5 * (block.width - 1), block.y + 0.5 * (block.height - 1));
  for (int y = block.y; y < block.y + block.height; ++y) {
    for (int x = block.x; x < block.x + block.width; ++x) {
      const float weight = surface.weight.at<float>(y, x);
      if (weight <= 0 || surface.depth.at<float>(y, x) <= 0 || weight < largest) continue;
      const double distance = std::hypot(x - middle.x, y - middle.y);
      if (weight == largest && distance >= nearest) continue;
      largest = weight;
      nearest = distance;
      *best = {x, y};
    }
  }
  return largest > 0;
}

}  // namespace

void cover(const std::vector<Surface>& surfaces, int block, double tolerance,
           std::vector<SurfacePoint>* points) {
  for (const Surface& surface : surfaces) {
    const cv::Rect image(0, 0, surface.view.width, surface.view.height);
    const cv::Mat occupied = occupied_blocks(surface, block, tolerance, *points);
    for (int by = 0; by < occupied.rows; ++by) {
      for (int bx = 0; bx < occupied.cols; ++bx) {
        if (occupied.at<std::uint8_t>(by, bx)) continue;
        cv::Point best;
        if (!best_pixel(surface, cv::Rect(bx * block, by * block, block, block) & image, &best)) {
          continue;
        }
        points->push_back(
            {surface.view.at(best.x + 0.5, best.y + 0.5, surface.depth.at<float>(best)),
             surface.rgb.at<cv::Vec3b>(best)});
        if (!surface.normal.empty()) points->back().normal = surface.normal.at<cv::Vec3f>(best);
      }
    }
  }
}

int cover_within(const std::vector<Surface>& surfaces, int limit, double tolerance,
                 std::vector<SurfacePoint>* points) {
  for (int block = 2;; block = std::max(block + 1, block * 5 / 4)) {
    std::vector<SurfacePoint> chosen = *points;
    cover(surfaces, block, tolerance, &chosen);
    // Above this block size there is one point per image, the minimum.
    if (int(chosen.size()) <= limit || block > 4096) {
      *points = std::move(chosen);
      return block;
    }
  }
}

InitialPoint initial_point(const SurfacePoint& point, const cv::Vec3d& velocity, int frame) {
  InitialPoint out{};
  const cv::Vec3f normal = cv::normalize(point.normal);  // 0 remains 0
  for (int k = 0; k < 3; ++k) {
    out.position[k] = float(point.position[k]);
    out.colour[k] = point.colour[k];
    out.normal[k] = normal[k];
    out.velocity[k] = float(velocity[k]);
  }
  out.frame = frame;
  return out;
}

}  // namespace stgs::encoder::init
