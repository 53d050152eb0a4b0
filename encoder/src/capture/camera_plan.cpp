// SPDX-License-Identifier: Apache-2.0
#include "camera_plan.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace stgs::encoder {
namespace {

// OpenCV's maps put pixel centres at integers.
cv::Matx33d opencv_matrix(const SourceCamera& source, double zoom) {
  return {source.fx * zoom, 0, source.cx - 0.5, 0, source.fy * zoom, source.cy - 0.5, 0, 0, 1};
}

// Where the pixels `points` (integer centres) of the undistorted picture lie in the source.
std::vector<cv::Point2d> distort(const SourceCamera& source, double zoom,
                                 const std::vector<cv::Point2d>& points) {
  const cv::Matx33d from = opencv_matrix(source, zoom), to = opencv_matrix(source, 1);
  std::vector<cv::Point2d> rays, result;
  std::vector<cv::Point3d> on_plane;
  for (const cv::Point2d& p : points) {
    const double x = (p.x - from(0, 2)) / from(0, 0), y = (p.y - from(1, 2)) / from(1, 1);
    rays.emplace_back(x, y);
    on_plane.emplace_back(x, y, 1.0);
  }
  if (source.lens == LensModel::kFisheye) {
    cv::fisheye::distortPoints(rays, result, to, source.distortion);
  } else {
    cv::projectPoints(on_plane, cv::Vec3d(), cv::Vec3d(), to, source.distortion, result);
  }
  return result;
}

// All border pixels come from within the source, but for half a pixel.
bool covered(const SourceCamera& source, double zoom, const FrameInfo& info) {
  std::vector<cv::Point2d> border;
  for (int x = 0; x < info.width; ++x) {
    border.emplace_back(x, 0);
    border.emplace_back(x, info.height - 1);
  }
  for (int y = 0; y < info.height; ++y) {
    border.emplace_back(0, y);
    border.emplace_back(info.width - 1, y);
  }
  const std::vector<cv::Point2d> sources = distort(source, zoom, border);
  return std::all_of(sources.begin(), sources.end(), [&](const cv::Point2d& p) {
    return p.x >= -0.5 && p.y >= -0.5 && p.x <= info.width - 0.5 && p.y <= info.height - 0.5;
  });
}

void plan_undistortion(const SourceCamera& source, CameraPlan& plan) {
  const FrameInfo& info = plan.source;
  double low = 1, high = kMaxUndistortionZoom;
  if (!covered(source, 1, info)) {
    plan.has_border = !covered(source, high, info);
    while (!plan.has_border && high - low > 1e-4) {
      const double middle = 0.5 * (low + high);
      (covered(source, middle, info) ? high : low) = middle;
    }
    plan.zoom = plan.has_border ? 1 : high;
  }
  const cv::Matx33d from = opencv_matrix(source, 1), to = opencv_matrix(source, plan.zoom);
  const cv::Size size(info.width, info.height);
  if (source.lens == LensModel::kFisheye) {
    cv::fisheye::initUndistortRectifyMap(from, source.distortion, cv::Matx33d::eye(), to, size,
                                         CV_32FC1, plan.map_x, plan.map_y);
  } else {
    cv::initUndistortRectifyMap(from, source.distortion, cv::noArray(), to, size, CV_32FC1,
                                plan.map_x, plan.map_y);
  }
}

// The intrinsics for the size that the frames have.
Result<SourceCamera> fitted(SourceCamera camera, const FrameInfo& info) {
  if (camera.width == 0 && camera.height == 0) {
    camera.width = info.width;
    camera.height = info.height;
  }
  const double sx = static_cast<double>(info.width) / camera.width;
  const double sy = static_cast<double>(info.height) / camera.height;
  if (!(sx > 0 && sy > 0) || std::abs(sx / sy - 1) > 0.01) {
    return invalid_file(
        "{}: the frames of camera '{}' are {}x{}, but its calibration is for "
        "{}x{}, another shape",
        camera.video.empty() ? camera.images.front() : camera.video, camera.name, info.width,
        info.height, camera.width, camera.height);
  }
  camera.fx *= sx;
  camera.fy *= sy;
  camera.cx *= sx;
  camera.cy *= sy;
  return camera;
}

}  // namespace

Result<CameraPlan> plan_camera(const SourceCamera& given, const FrameInfo& info, double scale) {
  STGS_ASSIGN(const SourceCamera source, fitted(given, info));
  CameraPlan plan;
  plan.source = info;
  if (source.lens != LensModel::kPinhole) plan_undistortion(source, plan);
  plan.camera.name = source.name;
  plan.camera.width = std::max(1, static_cast<int>(std::lround(info.width * scale)));
  plan.camera.height = std::max(1, static_cast<int>(std::lround(info.height * scale)));
  // Rounding to whole pixels makes the two directions' scales differ a little.
  const double sx = static_cast<double>(plan.camera.width) / info.width;
  const double sy = static_cast<double>(plan.camera.height) / info.height;
  plan.camera.fx = source.fx * plan.zoom * sx;
  plan.camera.fy = source.fy * plan.zoom * sy;
  plan.camera.cx = source.cx * sx;
  plan.camera.cy = source.cy * sy;
  std::copy_n(source.rotation, 9, plan.camera.rotation);
  std::copy_n(source.translation, 3, plan.camera.translation);
  return plan;
}

cv::Mat CameraPlan::frame(const cv::Mat& image) const {
  cv::Mat straight = image, scaled;
  if (!map_x.empty()) {
    cv::remap(image, straight, map_x, map_y, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  }
  if (straight.cols == camera.width && straight.rows == camera.height) return straight;
  cv::resize(straight, scaled, {camera.width, camera.height}, 0, 0, cv::INTER_AREA);
  return scaled;
}

cv::Mat CameraPlan::mask(const cv::Mat& mask) const {
  double largest = 0;
  cv::minMaxLoc(mask, nullptr, &largest);
  cv::Mat straight = mask > (largest <= 1 ? 0 : 127), scaled;  // masks come as 0/1 and as 0/255
  if (!map_x.empty()) {
    cv::remap(straight.clone(), straight, map_x, map_y, cv::INTER_NEAREST, cv::BORDER_CONSTANT);
  }
  if (straight.cols == camera.width && straight.rows == camera.height) return straight;
  cv::resize(straight, scaled, {camera.width, camera.height}, 0, 0, cv::INTER_NEAREST_EXACT);
  return scaled;
}

}  // namespace stgs::encoder
