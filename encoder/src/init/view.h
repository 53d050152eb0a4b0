// SPDX-License-Identifier: Apache-2.0
// A training camera at the working resolution of an initialisation stage, and its images.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder::init {

// Pixel centres are at +0.5 and axes are OpenCV's, as in Camera. `camera` points into the capture,
// which must outlive the view.
struct View {
  const Camera* camera = nullptr;
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  cv::Matx33d rotation;
  cv::Vec3d translation, centre;  // `centre` is the camera position in world space

  cv::Size size() const { return {width, height}; }
  cv::Vec3d to_camera(const cv::Vec3d& p) const { return rotation * p + translation; }
  // Returns the world-space ray through image position (u, v), scaled to depth 1.
  cv::Vec3d ray(double u, double v) const {
    return rotation.t() * cv::Vec3d((u - cx) / fx, (v - cy) / fy, 1.0);
  }
  // Returns the world-space point at image position (u, v) and depth.
  cv::Vec3d at(double u, double v, double depth) const { return centre + depth * ray(u, v); }
  cv::Vec3d forward() const { return {rotation(2, 0), rotation(2, 1), rotation(2, 2)}; }
};

inline cv::Vec3d position_of(const InitialPoint& point) {
  return {point.position[0], point.position[1], point.position[2]};
}

// Projection of a point. `inside` is false behind the camera and outside the image.
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

// Returns the camera with its longer side reduced to at most `max_side` pixels.
View make_view(const Camera& camera, int max_side);

// Returns the views of the cameras that are not held out.
std::vector<View> training_views(const PreparedCapture& capture, int max_side);

// Scales an 8-bit RGB image down to the size of `out`, which is allocated: the result of cv::resize
// with INTER_AREA (within 1 level), in less time if the factor is whole.
void scale_down(const cv::Mat& image, cv::Mat& out);

// Load the frame (8-bit RGB) or the mask (8-bit, 0 or 255) at the size of the view. A missing mask
// is an empty matrix. kRuntime for a test camera, which must not influence the points.
Result<cv::Mat> load_image(const PreparedCapture& capture, const View& view, int frame);
Status load_image_to(const PreparedCapture& capture, const View& view, int frame,
                     std::uint8_t* rgb);  // rows without gaps
Result<cv::Mat> load_mask_image(const PreparedCapture& capture, const View& view, int frame);

// Writes a PNG file atomically.
Status write_png(const std::string& path, const cv::Mat& rgb_or_grey);

// Views that a depth map of a view is computed from.
inline constexpr int kNeighbours = 3;

// Returns up to `count` other views with a similar line of sight to `focus`, best suited for stereo
// first.
std::vector<int> neighbours(const std::vector<View>& views, int reference, const cv::Vec3d& focus,
                            int count);

// Returns up to `count` views spread over the rig by farthest-point selection, in ascending order.
std::vector<int> spread(const std::vector<View>& views, int count);

// The point closest to all optical axes and its median depth. The depth is 0 if there is none
// (parallel or diverging cameras, or fewer than two).
struct Focus {
  cv::Vec3d point;
  double depth = 0;
};
Focus find_focus(const std::vector<View>& views);

}  // namespace stgs::encoder::init
