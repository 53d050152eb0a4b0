// SPDX-License-Identifier: Apache-2.0
#include "train/start_camera.h"

#include <algorithm>
#include <array>
#include <limits>

namespace stgs::encoder {
namespace {

const Camera& central_camera(const std::vector<Camera>& cameras) {
  std::vector<std::array<double, 3>> centres;
  std::array<double, 3> mean{};
  for (const Camera& camera : cameras) {
    std::array<double, 3> centre{};
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < 3; ++k) centre[c] -= camera.rotation[3 * k + c] * camera.translation[k];
      mean[c] += centre[c] / static_cast<double>(cameras.size());
    }
    centres.push_back(centre);
  }
  std::size_t best = 0;
  double best_distance = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < centres.size(); ++i) {
    double distance = 0;
    for (int c = 0; c < 3; ++c) distance += (centres[i][c] - mean[c]) * (centres[i][c] - mean[c]);
    if (distance < best_distance) {
      best_distance = distance;
      best = i;
    }
  }
  return cameras[best];
}

}  // namespace

StartCamera start_camera(const std::vector<Camera>& cameras) {
  const Camera& camera = central_camera(cameras);
  StartCamera start;
  std::copy_n(camera.rotation, 9, start.rotation);
  std::copy_n(camera.translation, 3, start.translation);
  start.fx = static_cast<float>(camera.fx);
  start.fy = static_cast<float>(camera.fy);
  start.cx = static_cast<float>(camera.cx);
  start.cy = static_cast<float>(camera.cy);
  start.width = static_cast<std::uint32_t>(camera.width);
  start.height = static_cast<std::uint32_t>(camera.height);
  return start;
}

}  // namespace stgs::encoder
