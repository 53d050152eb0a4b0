// SPDX-License-Identifier: Apache-2.0
#include "init/stereo_depth.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "geometry/stereo.h"
#include "init/static_points.h"

namespace stgs::encoder::init {
namespace {

constexpr std::size_t kMinViews = 3;  // two must confirm the depth of one
// Full size gives no better points (basketball, workshop_ring), but takes four times as long.
constexpr int kMinSide = 160, kMaxSide = 320;  // longer side of the images, pixels

geometry::StereoView stereo_view(const View& view, const cv::Mat& rgb) {
  geometry::StereoView out;
  out.width = view.width;
  out.height = view.height;
  out.fx = float(view.fx);
  out.fy = float(view.fy);
  out.cx = float(view.cx);
  out.cy = float(view.cy);
  const math::PinholeCamera camera = view.camera->pinhole(0.0f);
  out.rotation = camera.rotation;
  out.translation = camera.translation;
  cv::Mat small = rgb, grey;
  if (rgb.size() != view.size()) cv::resize(rgb, small, view.size(), 0, 0, cv::INTER_AREA);
  cv::cvtColor(small, grey, cv::COLOR_RGB2GRAY);
  out.grey.assign(grey.datastart, grey.dataend);
  return out;
}

StereoDepth depth_of(const geometry::StereoView& view, const geometry::StereoMap& map) {
  const cv::Size size(view.width, view.height);
  StereoDepth out{cv::Mat(size, CV_32F, cv::Scalar(0)), cv::Mat(size, CV_32FC3, cv::Scalar(0)),
                  cv::Mat(size, CV_32F, cv::Scalar(1))};
  for (std::size_t i = 0; i < map.planes.size(); ++i) {
    if (map.confirmations[i] == 0) continue;
    const geometry::Hypothesis& plane = map.planes[i];
    const math::Vec3 normal = math::mat3_transpose_mul(view.rotation, plane.normal);
    out.depth.ptr<float>()[i] = plane.depth;
    out.normal.ptr<cv::Vec3f>()[i] = {normal.x, normal.y, normal.z};
    out.cost.ptr<float>()[i] = std::min(1.0f, map.costs[i]);
  }
  return out;
}

}  // namespace

Result<std::vector<StereoDepth>> match_static(const std::vector<StaticImage>& inputs,
                                              const cv::Vec3d& focus, const DepthRange& range,
                                              const StereoChoice& choice, Work& work) {
  std::vector<StereoDepth> depths;
  std::vector<View> views;
  for (const StaticImage& input : inputs) {
    const int half = std::max(input.view.camera->width, input.view.camera->height) / 2;
    views.push_back(make_view(*input.view.camera, std::clamp(half, kMinSide, kMaxSide)));
  }
  if (views.size() < kMinViews) return depths;
  work.stage("stereo", geometry::kStereoLoops);
  std::vector<geometry::StereoView> images;
  for (std::size_t i = 0; i < views.size(); ++i) {
    images.push_back(stereo_view(views[i], inputs[i].rgb));
    images.back().sources = neighbours(views, int(i), focus, geometry::kMaxSources);
  }
  geometry::StereoSettings settings;
  settings.nearest = float(range.nearest);
  settings.farthest = float(range.farthest);
  settings.seed = choice.seed;
  STGS_ASSIGN(const auto matcher,
              geometry::make_matcher(
                  choice.backend, choice.gpu,
                  [&work](int level, const std::string& line) { work.log(line, level); }));
  STGS_ASSIGN(const std::vector<geometry::StereoMap> maps,
              geometry::match_views(images, settings, *matcher,
                                    [&work](int count, const std::function<Status(int)>& task) {
                                      return work.for_each(count, task);
                                    }));
  std::size_t confirmed = 0, pixels = 0;
  for (std::size_t i = 0; i < maps.size(); ++i) {
    depths.push_back(depth_of(images[i], maps[i]));
    confirmed += std::size_t(cv::countNonZero(depths.back().depth > 0));
    pixels += maps[i].planes.size();
  }
  work.log(fmt::format("stereo: {:.0f} % of the pixels are confirmed by other views, backend {}",
                       100.0 * double(confirmed) / double(pixels), matcher->name()));
  return depths;
}

}  // namespace stgs::encoder::init
