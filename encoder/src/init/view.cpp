// SPDX-License-Identifier: Apache-2.0
#include "init/view.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "stgs/format/output_file.h"

namespace stgs::encoder::init {
namespace {

// Guards against leaking a held-out camera into the initial points.
Status reject_test(const View& view) {
  if (!view.camera->test) return {};
  return runtime_error("camera '{}' is held out, so the initialisation must not read it",
                       view.camera->name);
}

cv::Mat as_mat(const Image8& image) {
  const int type = image.channels == 1 ? CV_8UC1 : CV_8UC3;
  return cv::Mat(image.height, image.width, type, const_cast<std::uint8_t*>(image.data.data()));
}

}  // namespace

View make_view(const Camera& camera, int max_side) {
  const double scale = std::min(1.0, double(max_side) / std::max(camera.width, camera.height));
  View view;
  view.camera = &camera;
  view.width = std::max(1, int(std::lround(camera.width * scale)));
  view.height = std::max(1, int(std::lround(camera.height * scale)));
  const double sx = double(view.width) / camera.width, sy = double(view.height) / camera.height;
  view.fx = camera.fx * sx;
  view.cx = camera.cx * sx;
  view.fy = camera.fy * sy;
  view.cy = camera.cy * sy;
  view.rotation = cv::Matx33d(camera.rotation);
  view.translation = cv::Vec3d(camera.translation);
  view.centre = -(view.rotation.t() * view.translation);
  return view;
}

std::vector<View> training_views(const PreparedCapture& capture, int max_side) {
  std::vector<View> views;
  for (const Camera& camera : capture.cameras) {
    if (!camera.test) views.push_back(make_view(camera, max_side));
  }
  return views;
}

namespace {

// Averages squares of `factor` pixels. Columns are summed first, which vectorises.
void average_squares(const cv::Mat& image, int factor, cv::Mat& out) {
  const float share = 1.0f / float(factor * factor);
  const std::size_t values = std::size_t(image.cols) * 3;
  std::vector<std::uint16_t> columns(values);
  for (int y = 0; y < out.rows; ++y) {
    std::fill(columns.begin(), columns.end(), 0);
    for (int k = 0; k < factor; ++k) {
      const std::uint8_t* const row = image.ptr(y * factor + k);
      for (std::size_t i = 0; i < values; ++i) columns[i] = std::uint16_t(columns[i] + row[i]);
    }
    std::uint8_t* const to = out.ptr(y);
    for (int x = 0; x < out.cols; ++x) {
      const std::uint16_t* const square = &columns[std::size_t(3) * factor * x];
      int sum[3] = {0, 0, 0};
      for (int k = 0; k < factor; ++k)
        for (int c = 0; c < 3; ++c) sum[c] += square[3 * k + c];
      for (int c = 0; c < 3; ++c)
        to[3 * x + c] = cv::saturate_cast<std::uint8_t>(float(sum[c]) * share);
    }
  }
}

}  // namespace

void scale_down(const cv::Mat& image, cv::Mat& out) {
  constexpr int kMinFactor = 3, kMaxFactor = 256;  // OpenCV is as fast for 2
  const int factor = image.cols / out.cols;
  const bool is_whole = image.size() == cv::Size(out.cols * factor, out.rows * factor);
  if (is_whole && factor >= kMinFactor && factor <= kMaxFactor)
    average_squares(image, factor, out);
  else
    cv::resize(image, out, out.size(), 0, 0, cv::INTER_AREA);
}

Status load_image_to(const PreparedCapture& capture, const View& view, int frame,
                     std::uint8_t* rgb) {
  STGS_TRY(reject_test(view));
  STGS_ASSIGN(const auto image, load_shared_frame(capture, *view.camera, frame));
  cv::Mat out(view.size(), CV_8UC3, rgb);
  scale_down(as_mat(*image), out);
  return {};
}

Result<cv::Mat> load_image(const PreparedCapture& capture, const View& view, int frame) {
  cv::Mat out(view.size(), CV_8UC3);
  STGS_TRY(load_image_to(capture, view, frame, out.data));
  return out;
}

Result<cv::Mat> load_mask_image(const PreparedCapture& capture, const View& view, int frame) {
  STGS_TRY(reject_test(view));
  STGS_ASSIGN(const Image8 image, load_mask(capture, *view.camera, frame));
  if (image.data.empty()) return cv::Mat();
  cv::Mat out = as_mat(image);
  if (out.size() != view.size()) cv::resize(out, out, view.size(), 0, 0, cv::INTER_AREA);
  return cv::Mat(out >= 128);
}

Status write_png(const std::string& path, const cv::Mat& rgb_or_grey) {
  std::vector<std::uint8_t> bytes;
  cv::Mat image = rgb_or_grey;
  if (rgb_or_grey.channels() == 3) cv::cvtColor(rgb_or_grey, image, cv::COLOR_RGB2BGR);
  // Without parameters OpenCV uses its fastest settings. Any explicit level tries all filters.
  if (!cv::imencode(".png", image, bytes))
    return io_error("{}: cannot encode the image as PNG", path);
  return write_file_atomically(path, bytes);
}

std::vector<int> neighbours(const std::vector<View>& views, int reference, const cv::Vec3d& focus,
                            int count) {
  const View& view = views[reference];
  std::vector<std::pair<double, int>> scored;
  for (int i = 0; i < int(views.size()); ++i) {
    const cv::Vec3d step = views[i].centre - view.centre;
    const double baseline = cv::norm(step);
    if (i == reference || baseline < 1e-9) continue;
    if (views[i].forward().dot(view.forward()) < 0.3) continue;  // faces other surfaces
    const cv::Vec3d a = focus - view.centre, b = focus - views[i].centre;
    const double cosine = a.dot(b) / std::max(1e-12, cv::norm(a) * cv::norm(b));
    const double degrees = std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / CV_PI;
    // Depth is inaccurate below about 4 degrees; patches differ too much far above 12 degrees.
    scored.emplace_back(degrees < 4 ? 4 + 2 * (4 - degrees) : degrees, i);
  }
  std::sort(scored.begin(), scored.end());
  std::vector<int> out;
  for (const auto& [score, i] : scored) {
    if (int(out.size()) < count) out.push_back(i);
  }
  return out;
}

std::vector<int> spread(const std::vector<View>& views, int count) {
  std::vector<int> chosen;
  std::vector<double> distance(views.size(), 1e300);
  int next = 0;
  while (int(chosen.size()) < std::min(count, int(views.size()))) {
    chosen.push_back(next);
    for (std::size_t i = 0; i < views.size(); ++i) {
      distance[i] = std::min(distance[i], cv::norm(views[i].centre - views[next].centre));
      if (std::find(chosen.begin(), chosen.end(), int(i)) != chosen.end()) distance[i] = -1;
    }
    next = int(std::max_element(distance.begin(), distance.end()) - distance.begin());
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

Focus find_focus(const std::vector<View>& views) {
  cv::Matx33d a = cv::Matx33d::zeros();
  cv::Vec3d b(0, 0, 0), mean(0, 0, 0);
  for (const View& view : views) {
    const cv::Vec3d d = cv::normalize(view.forward());
    const cv::Matx33d across = cv::Matx33d::eye() - d * d.t();
    a += across;
    b += across * view.centre;
    mean += view.centre * (1.0 / double(views.size()));
  }
  Focus focus;
  focus.point = mean;
  cv::Vec3d eigenvalues;
  cv::eigen(a, eigenvalues);
  if (views.size() < 2 || eigenvalues[2] < 1e-3 * double(views.size())) return focus;
  const cv::Vec3d point = a.solve(b, cv::DECOMP_CHOLESKY);
  std::vector<double> depths;
  depths.reserve(views.size());
  for (const View& view : views) depths.push_back(view.to_camera(point)[2]);
  std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
  if (depths[depths.size() / 2] <= 0) return focus;
  focus.point = point;
  focus.depth = depths[depths.size() / 2];
  return focus;
}

}  // namespace stgs::encoder::init
