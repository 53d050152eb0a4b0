// SPDX-License-Identifier: Apache-2.0
// A training camera at the resolution that a step of the initialisation works at, and its pictures.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder::init {

// Pixel centres at +0.5, OpenCV axes, as Camera; `camera` is borrowed from the capture.
struct View {
  const Camera* camera = nullptr;
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  cv::Matx33d rotation;
  cv::Vec3d translation, centre;

  cv::Size size() const { return {width, height}; }
  cv::Vec3d to_camera(const cv::Vec3d& p) const { return rotation * p + translation; }
  // World-space direction through image position (u, v), of length such that its depth is 1.
  cv::Vec3d ray(double u, double v) const {
    return rotation.t() * cv::Vec3d((u - cx) / fx, (v - cy) / fy, 1.0);
  }
  cv::Vec3d at(double u, double v, double depth) const { return centre + depth * ray(u, v); }
  cv::Vec3d forward() const { return {rotation(2, 0), rotation(2, 1), rotation(2, 2)}; }
};

// Where a point falls; inside is false behind the camera and outside the image.
struct Pixel {
  double u = 0, v = 0, depth = 0;
  bool inside = false;
  int x() const { return static_cast<int>(u); }
  int y() const { return static_cast<int>(v); }
};

inline Pixel project(const View& view, const cv::Vec3d& p) {
  Pixel pixel;
  const cv::Vec3d c = view.to_camera(p);
  pixel.depth = c[2];
  if (c[2] <= 1e-9) return pixel;
  pixel.u = view.fx * c[0] / c[2] + view.cx;
  pixel.v = view.fy * c[1] / c[2] + view.cy;
  pixel.inside = pixel.u >= 0 && pixel.v >= 0 && pixel.u < view.width && pixel.v < view.height;
  return pixel;
}

// The camera with its longer side reduced to at most `longest` pixels.
View make_view(const Camera& camera, int longest);

// Views of the cameras that are not held out.
std::vector<View> training_views(const PreparedCapture& capture, int longest);

// The frame (8-bit RGB) or mask (8-bit, 0 or 255) at the view's size; an empty mask where there is
// none. Never call for a test camera: it is refused.
Result<cv::Mat> load_picture(const PreparedCapture& capture, const View& view, int frame);
Result<cv::Mat> load_mask_picture(const PreparedCapture& capture, const View& view, int frame);

// Writes a PNG under a temporary name and renames it.
Status write_png(const std::string& path, const cv::Mat& rgb_or_grey);

// Up to `count` other views that see what `reference` sees from near it, nearest first.
std::vector<int> neighbours(const std::vector<View>& views, int reference, const cv::Vec3d& focus,
                            int count);

// Up to `count` views spread over the rig, chosen by farthest point.
std::vector<int> spread(const std::vector<View>& views, int count);

// Where the optical axes meet best, and its median depth; depth 0 where they do not (parallel or
// diverging cameras, fewer than two of them).
struct Focus {
  cv::Vec3d point;
  double depth = 0;
};
Focus find_focus(const std::vector<View>& views);

}  // namespace stgs::encoder::init
