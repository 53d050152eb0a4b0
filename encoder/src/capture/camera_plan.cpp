// SPDX-License-Identifier: Apache-2.0
#include "camera_plan.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "geometry/view_matcher.h"

namespace stgs::encoder {
namespace {

// Intrinsics in OpenCV's convention, with pixel centres at integers.
cv::Matx33d opencv_matrix(const SourceCamera& source, double zoom) {
  return {source.fx * zoom, 0, source.cx - 0.5, 0, source.fy * zoom, source.cy - 0.5, 0, 0, 1};
}

// Returns the source positions of undistorted pixels. Both have integer pixel centres.
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

// Returns true if every border pixel has a source position inside the image area.
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
  plan.lens = source.lens;
  plan.distortion = source.distortion;
  plan.from = opencv_matrix(source, 1);
  plan.to = opencv_matrix(source, plan.zoom);
}

// Returns where the frames of a camera come from, for messages.
std::string frames_of(const SourceCamera& camera) {
  if (!camera.video.empty()) return camera.video;
  if (!camera.images.empty()) return camera.images.front();
  return camera.live_source.empty() ? "pushed frames" : camera.live_source;
}

// Returns the camera with its intrinsics scaled to the size of the frames.
Result<SourceCamera> scaled_to_frames(SourceCamera camera, const FrameInfo& info) {
  if (camera.width == 0 && camera.height == 0) {
    camera.width = info.width;
    camera.height = info.height;
  }
  const double sx = static_cast<double>(info.width) / camera.width;
  const double sy = static_cast<double>(info.height) / camera.height;
  if (!(sx > 0 && sy > 0) || std::abs(sx / sy - 1) > 0.01) {
    return invalid_file(
        "{}: frames of camera '{}' do not match the aspect ratio of its calibration (expected "
        "{}x{}, got {}x{}); use frames that are not cropped or rotated",
        frames_of(camera), camera.name, camera.width, camera.height, info.width, info.height);
  }
  camera.fx *= sx;
  camera.fy *= sy;
  camera.cx *= sx;
  camera.cy *= sy;
  return camera;
}

}  // namespace

Result<CameraPlan> plan_camera(const SourceCamera& given, const FrameInfo& info, double scale) {
  STGS_ASSIGN(const SourceCamera source, scaled_to_frames(given, info));
  CameraPlan plan;
  plan.source = info;
  if (source.lens != LensModel::kPinhole) plan_undistortion(source, plan);
  plan.camera.name = source.name;
  plan.camera.width = std::max(1, static_cast<int>(std::lround(info.width * scale)));
  plan.camera.height = std::max(1, static_cast<int>(std::lround(info.height * scale)));
  // The horizontal and vertical scales differ slightly because the size is rounded to pixels.
  const double sx = static_cast<double>(plan.camera.width) / info.width;
  const double sy = static_cast<double>(plan.camera.height) / info.height;
  plan.camera.fx = source.fx * plan.zoom * sx;
  plan.camera.fy = source.fy * plan.zoom * sy;
  plan.camera.cx = source.cx * sx;
  plan.camera.cy = source.cy * sy;
  std::copy_n(source.rotation, 9, plan.camera.rotation);
  std::copy_n(source.translation, 3, plan.camera.translation);
  plan.camera.time_offset = source.time_offset;
  plan.camera.fps = source.fps;
  return plan;
}

FrameMapping::FrameMapping(const CameraPlan& plan) : plan_(plan) {
  const cv::Size size(plan.source.width, plan.source.height);
  if (plan.lens == LensModel::kFisheye) {
    cv::fisheye::initUndistortRectifyMap(plan.from, plan.distortion, cv::Matx33d::eye(), plan.to,
                                         size, CV_32FC1, map_x_, map_y_);
  } else if (plan.lens == LensModel::kOpenCv) {
    cv::initUndistortRectifyMap(plan.from, plan.distortion, cv::noArray(), plan.to, size, CV_32FC1,
                                map_x_, map_y_);
  }
}

Result<MappingDevice> choose_mapping_device(const PrepareSettings& settings, const LogSink& log) {
  MappingDevice mapping_device;
  STGS_ASSIGN(mapping_device.gpu,
              geometry::make_frame_warper(settings.backend, settings.share.index, log));
  mapping_device.required = settings.backend == "cuda";
  mapping_device.log = log;
  return mapping_device;
}

Result<std::unique_ptr<FrameMapping>> FrameMapping::make(const CameraPlan& plan,
                                                         const MappingDevice& mapping_device) {
  auto mapping = std::make_unique<FrameMapping>(plan);
  if (!mapping_device.gpu) return mapping;
  geometry::WarpCamera camera;
  camera.source_width = plan.source.width;
  camera.source_height = plan.source.height;
  camera.width = plan.camera.width;
  camera.height = plan.camera.height;
  if (!mapping->map_x_.empty()) {
    camera.map_x = mapping->map_x_.ptr<float>();
    camera.map_y = mapping->map_y_.ptr<float>();
  }
  Result<std::unique_ptr<geometry::FrameWarp>> warp = mapping_device.gpu->make(camera);
  if (warp.ok()) {
    mapping->warp_ = std::move(*warp);
    return mapping;
  }
  const Status& status = warp.status();
  const std::string reason = fmt::format("camera '{}': {}", plan.camera.name, status.message());
  if (mapping_device.required || status.code() != StatusCode::kNoMemory)
    return Status(status.code(), reason + "; use --backend cpu");
  mapping_device.log(2, reason + "; the CPU changes them");
  return mapping;
}

template <typename Source>
Result<cv::Mat> FrameMapping::on_gpu(const Source& source) const {
  cv::Mat out(plan_.camera.height, plan_.camera.width, CV_8UC3);
  const Status status = warp_->run(source, out.data);
  if (status.ok()) return out;
  return Status(status.code(), fmt::format("camera '{}': {}; --backend cpu does without the GPU",
                                           plan_.camera.name, status.message()));
}

Result<cv::Mat> FrameMapping::frame(const geometry::YuvFrame& frame) const {
  return on_gpu(frame);
}

Result<cv::Mat> FrameMapping::frame(const cv::Mat& image) const {
  if (plan_.is_identity()) return image;
  if (!warp_) return on_cpu(image);
  return on_gpu(
      geometry::PackedImage{image.data, image.cols, image.rows, image.step[0], image.channels()});
}

cv::Mat FrameMapping::on_cpu(const cv::Mat& image) const {
  const Camera& camera = plan_.camera;
  cv::Mat undistorted, scaled;  // of their own memory: the image may be used again
  if (map_x_.empty())
    undistorted = image;
  else
    cv::remap(image, undistorted, map_x_, map_y_, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  if (undistorted.cols == camera.width && undistorted.rows == camera.height) return undistorted;
  cv::resize(undistorted, scaled, {camera.width, camera.height}, 0, 0, cv::INTER_AREA);
  return scaled;
}

cv::Mat FrameMapping::mask(const cv::Mat& mask) const {
  const Camera& camera = plan_.camera;
  double largest = 0;
  cv::minMaxLoc(mask, nullptr, &largest);
  cv::Mat undistorted = mask > (largest <= 1 ? 0 : 127), scaled;  // masks use 0/1 or 0/255
  if (!map_x_.empty()) {
    cv::remap(undistorted.clone(), undistorted, map_x_, map_y_, cv::INTER_NEAREST,
              cv::BORDER_CONSTANT);
  }
  if (undistorted.cols == camera.width && undistorted.rows == camera.height) return undistorted;
  cv::resize(undistorted, scaled, {camera.width, camera.height}, 0, 0, cv::INTER_NEAREST_EXACT);
  return scaled;
}

}  // namespace stgs::encoder
