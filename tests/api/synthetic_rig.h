// SPDX-License-Identifier: Apache-2.0
// A small ray-cast scene with known geometry: a textured wall and floor, and a textured ball that
// moves at constant velocity. Units are metres, axes are OpenCV's (y down).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>

#include "init/view.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

class SyntheticRig {
 public:
  static constexpr double kBallRadius = 0.35, kWallDepth = 3.6, kFloorHeight = 0.9;

  int frames = 5;
  cv::Vec3d start{-0.25, 0.2, 2.2};      // centre of the ball in frame 0
  cv::Vec3d velocity{0.09, -0.02, 0.0};  // of the ball, per frame
  bool ball = true;

  cv::Vec3d centre_at(int frame) const { return start + double(frame) * velocity; }

  // Writes the frames of `cameras` cameras on an arc into `folder`. The middle one is held out if
  // there are more than three.
  PreparedCapture write(const std::string& folder, int cameras) const {
    std::filesystem::remove_all(folder);
    PreparedCapture capture;
    capture.folder = folder;
    capture.frames = frames;
    capture.source = "synthetic";
    for (int i = 0; i < cameras; ++i) capture.cameras.push_back(camera(i, cameras));
    if (cameras > 3) capture.cameras[cameras / 2].test = true;
    for (const Camera& c : capture.cameras) {
      std::filesystem::create_directories(folder + "/frames/" + c.name);
      for (int f = 0; f < frames; ++f) {
        (void)init::write_png(capture.frame_path(c, f), render(c, f, nullptr));
      }
    }
    return capture;
  }

  // Renders a frame. `mask` (8-bit, may be null) is 255 where the ball is visible.
  cv::Mat render(const Camera& c, int frame, cv::Mat* mask) const {
    const init::View view = init::make_view(c, c.width);
    cv::Mat image(c.height, c.width, CV_8UC3);
    if (mask) *mask = cv::Mat(c.height, c.width, CV_8U, cv::Scalar(0));
    for (int y = 0; y < c.height; ++y) {
      for (int x = 0; x < c.width; ++x) {
        cv::Vec3d sum(0, 0, 0);
        bool hit = false;
        for (int s = 0; s < 4; ++s) {
          const cv::Vec3d ray = view.ray(x + 0.25 + 0.5 * (s & 1), y + 0.25 + 0.5 * (s >> 1));
          sum += 0.25 * shade(view.centre, ray, frame, &hit);
        }
        for (int k = 0; k < 3; ++k) image.at<cv::Vec3b>(y, x)[k] = std::uint8_t(sum[k]);
        if (mask && hit) mask->at<std::uint8_t>(y, x) = 255;
      }
    }
    return image;
  }

  // Distance of a point from the nearest static surface.
  static double from_static(const cv::Vec3d& p) {
    return std::min(std::abs(p[2] - kWallDepth), std::abs(p[1] - kFloorHeight));
  }
  double from_ball(const cv::Vec3d& p, int frame) const {
    return std::abs(cv::norm(p - centre_at(frame)) - kBallRadius);
  }

 private:
  static Camera camera(int i, int count) {
    const double a = count > 1 ? double(i) / (count - 1) - 0.5 : 0.0;
    const cv::Vec3d position(1.5 * a, 0.12 * (i % 2) - 0.1, 0.25 * a * a);
    const cv::Vec3d z = cv::normalize(cv::Vec3d(0, 0.25, 2.6) - position);
    const cv::Vec3d x = cv::normalize(cv::Vec3d(0, 1, 0).cross(z)), y = z.cross(x);
    Camera camera;
    camera.name = fmt::format("c{}", i);
    camera.width = 160;
    camera.height = 120;
    camera.fx = camera.fy = 140;
    camera.cx = 80;
    camera.cy = 60;
    const cv::Vec3d rows[3] = {x, y, z};
    for (int r = 0; r < 3; ++r) {
      for (int k = 0; k < 3; ++k) camera.rotation[3 * r + k] = rows[r][k];
      camera.translation[r] = -rows[r].dot(position);
    }
    return camera;
  }

  // Lattice noise in [0, 1].
  static double noise(const cv::Vec3d& p, std::uint32_t salt) {
    const cv::Vec3d base(std::floor(p[0]), std::floor(p[1]), std::floor(p[2]));
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      double weight = 1;
      std::uint32_t hash = salt;
      for (int k = 0; k < 3; ++k) {
        const int bit = corner >> k & 1;
        const double f = p[k] - base[k];
        weight *= bit ? f : 1 - f;
        hash = (hash ^ std::uint32_t(int(base[k]) + bit + 512)) * 0x9e3779b1u;
        hash ^= hash >> 15;
      }
      sum += weight * double(hash & 0xffff) / 65535.0;
    }
    return sum;
  }
  static cv::Vec3d texture(const cv::Vec3d& p, double scale, const cv::Vec3d& tint) {
    cv::Vec3d out;
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t salt = 17u + std::uint32_t(k);
      const double n = 0.6 * noise(p * (1 / scale), salt) + 0.4 * noise(p * (2.7 / scale), salt);
      out[k] = std::clamp(tint[k] * (0.35 + 1.1 * n), 0.0, 255.0);
    }
    return out;
  }

  cv::Vec3d shade(const cv::Vec3d& origin, const cv::Vec3d& ray, int frame, bool* hit) const {
    const cv::Vec3d c = centre_at(frame), o = origin - c;
    const double a = ray.dot(ray), b = o.dot(ray);
    const double root = b * b - a * (o.dot(o) - kBallRadius * kBallRadius);
    if (ball && root > 0) {
      *hit = true;
      return texture(origin + ray * ((-b - std::sqrt(root)) / a) - c, 0.08, {240, 90, 60});
    }
    const double wall = (kWallDepth - origin[2]) / ray[2];
    const double floor = ray[1] > 1e-9 ? (kFloorHeight - origin[1]) / ray[1] : 1e9;
    if (floor < wall) return texture(origin + ray * floor, 0.14, {150, 170, 120});
    return texture(origin + ray * wall, 0.17, {130, 140, 190});
  }
};

}  // namespace stgs::encoder
