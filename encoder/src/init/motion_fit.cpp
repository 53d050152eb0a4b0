// SPDX-License-Identifier: Apache-2.0
#include "init/motion_fit.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/parallel.h"

namespace stgs::encoder::init {
namespace {

constexpr int kCell = 6;           // pixels
constexpr double kSlack = 1.05;    // of depths
constexpr double kOutside = 64.0;  // grey levels

MotionFit fit_of(const View& view, const cv::Mat& mask, const cv::Mat& image,
                 const std::vector<SurfacePoint>& points, const Velocities& velocities) {
  std::vector<SurfacePoint> moved = points;
  for (std::size_t i = 0; i < points.size(); ++i) moved[i].position += velocities[i];
  const Fronts fronts(view, moved);
  MotionFit fit;
  for (const SurfacePoint& point : moved) {
    const Pixel p = project(view, point.position);
    if (!p.inside || fronts.hides(p)) continue;
    ++fit.samples;
    fit.inside += mask.at<std::uint8_t>(p.y(), p.x()) != 0 ? 1 : 0;
    const auto& c = image.at<cv::Vec3b>(p.y(), p.x());
    for (int k = 0; k < 3; ++k) fit.difference += std::abs(int(c[k]) - int(point.colour[k])) / 3.0;
  }
  return fit;
}

}  // namespace

Fronts::Fronts(const View& view, const std::vector<SurfacePoint>& points)
    : depth_((view.height + kCell - 1) / kCell, (view.width + kCell - 1) / kCell, CV_32F,
             cv::Scalar(1e30)) {
  for (const SurfacePoint& point : points) {
    const Pixel p = project(view, point.position);
    if (!p.inside) continue;
    float& depth = depth_.at<float>(p.y() / kCell, p.x() / kCell);
    depth = std::min(depth, float(p.depth));
  }
}

bool Fronts::hides(const Pixel& pixel) const {
  return pixel.depth > kSlack * depth_.at<float>(pixel.y() / kCell, pixel.x() / kCell);
}

double MotionFit::residual() const {
  if (samples == 0) return 1e9;
  return (difference + kOutside * double(samples - inside)) / double(samples);
}

void MotionFit::operator+=(const MotionFit& other) {
  samples += other.samples;
  inside += other.inside;
  difference += other.difference;
}

Result<std::vector<MotionFit>> measure_motion(const PreparedCapture& capture,
                                              const std::vector<View>& views,
                                              const std::vector<SurfacePoint>& points,
                                              std::span<const Velocities> estimates,
                                              int next_frame) {
  std::vector<Status> statuses(views.size());
  std::vector<std::vector<MotionFit>> fits(views.size());
  const auto measure = [&](std::size_t i) -> Status {
    STGS_ASSIGN(const cv::Mat mask, load_mask_image(capture, views[i], next_frame));
    if (mask.empty()) return {};
    STGS_ASSIGN(const cv::Mat image, load_image(capture, views[i], next_frame));
    for (const Velocities& velocities : estimates)
      fits[i].push_back(fit_of(views[i], mask, image, points, velocities));
    return {};
  };
  parallel_for(std::size_t{0}, views.size(), [&](std::size_t i) { statuses[i] = measure(i); });
  for (Status& status : statuses) STGS_TRY(status);
  std::vector<MotionFit> out(estimates.size());
  for (const std::vector<MotionFit>& of_view : fits)
    for (std::size_t k = 0; k < of_view.size(); ++k) out[k] += of_view[k];
  return out;
}

}  // namespace stgs::encoder::init
