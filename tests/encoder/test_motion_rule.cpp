// SPDX-License-Identifier: Apache-2.0
// The pixel rules of motion detection on a GPU, on the CPU, against OpenCV.
#include "geometry/motion_rule.h"

#include <opencv2/video/tracking.hpp>

#include "catch.h"
#include "init/background.h"
#include "motion_reference.h"
#include "moving_texture.h"

using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

const cv::Size kSizes[] = {{97, 65}, {64, 48}, {7, 5}, {2, 9}, {1, 1}};

cv::Mat random_image(cv::Size size, int type, int seed) {
  cv::Mat out(size, type);
  cv::RNG(seed).fill(out, cv::RNG::UNIFORM, 0, 256);
  return out;
}

cv::Mat dis_flow(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat from, to, out;
  cv::cvtColor(a, from, cv::COLOR_RGB2GRAY);
  cv::cvtColor(b, to, cv::COLOR_RGB2GRAY);
  const auto dis = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_ULTRAFAST);
  if (std::max(a.cols, a.rows) <= 320) dis->setFinestScale(0);
  dis->calc(from, to, out);
  return out;
}

}  // namespace

TEST_CASE("differences of images are those of OpenCV") {
  for (const cv::Size size : kSizes) {
    const cv::Mat a = random_image(size, CV_8UC3, 1), b = random_image(size, CV_8UC3, 2);
    const cv::Mat expected = init::difference(a, b);
    cv::Mat found(size, CV_8U);
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        int largest = 0;
        for (int c = 0; c < 3; ++c) {
          const int va = geometry::blurred_at(a.data, 3, size.width, size.height, x, y, c);
          const int vb = geometry::blurred_at(b.data, 3, size.width, size.height, x, y, c);
          largest = std::max(largest, std::abs(va - vb));
        }
        found.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(largest);
      }
    }
    INFO(size);
    CHECK(cv::norm(found, expected, cv::NORM_INF) == 0);
  }
}

TEST_CASE("thresholds of changes are those of OpenCV") {
  for (const cv::Size size : kSizes) {
    const cv::Mat image = random_image(size, CV_8UC3, 3);
    const cv::Mat expected = init::change_threshold(image, 1.7);
    cv::Mat grey(size, CV_8U), blurred(size, CV_8U), slope(size, CV_32S);
    const int width = size.width, height = size.height;
    for (int i = 0; i < width * height; ++i)
      grey.data[i] = static_cast<std::uint8_t>(geometry::grey_level_of(image.data + 3 * i));
    for (int i = 0; i < width * height; ++i)
      blurred.data[i] = static_cast<std::uint8_t>(
          geometry::blurred_at(grey.data, 1, width, height, i % width, i / width, 0));
    for (int i = 0; i < width * height; ++i)
      slope.at<int>(i / width, i % width) =
          geometry::squared_slope_at(blurred.data, width, height, i % width, i / width);
    INFO(size);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const cv::Rect around = cv::Rect(x - 1, y - 1, 3, 3) & cv::Rect({0, 0}, size);
        int largest = 0;
        for (int j = around.y; j < around.br().y; ++j)
          for (int i = around.x; i < around.br().x; ++i)
            largest = std::max(largest, slope.at<int>(j, i));
        const float found =
            geometry::change_threshold_of(largest, float(geometry::threshold_base(1.7)));
        CHECK(found == Approx(expected.at<float>(y, x)).epsilon(1e-6));
      }
    }
  }
}

TEST_CASE("flow of moving textures is as accurate as that of OpenCV's inverse search") {
  for (const double noise : {0.0, 3.0}) {
    for (const cv::Size size : {cv::Size(480, 270), cv::Size(237, 131)}) {
      for (const double speed : {1.0, 4.0, 9.0}) {
        const MovingTexture scene(size, {speed, -0.6 * speed}, noise);
        const cv::Mat a = scene.image(0), b = scene.image(1);
        const cv::Mat found = rule_flow(a, b, false), expected = dis_flow(a, b);
        INFO(size << ", speed " << speed << ", noise " << noise);
        CHECK(scene.error_of(found, false) < scene.error_of(expected, false) + 0.1);
        CHECK(scene.error_of(found, true) < scene.error_of(expected, true) + 0.25);
      }
    }
  }
}

TEST_CASE("checked flow is unknown where content appears, and zero without motion") {
  const MovingTexture scene({240, 135}, {6, 2}, 0);
  const cv::Mat still = rule_flow(scene.image(0), scene.image(0), true);
  CHECK(cv::norm(still, cv::NORM_INF) == 0);
  const cv::Mat flow = rule_flow(scene.image(0), scene.image(1), true);
  int unknown = 0, border = 0;
  for (int y = 0; y < flow.rows; ++y) {
    for (int x = 0; x < flow.cols; ++x) {
      const double r = cv::norm(cv::Point2d(x, y) - scene.centre(0));
      if (r > scene.radius() && r < scene.radius() + 6) ++border;
      const bool is_known = flow.at<cv::Vec2f>(y, x)[0] == flow.at<cv::Vec2f>(y, x)[0];
      unknown += is_known ? 0 : 1;
    }
  }
  CHECK(unknown > border / 4);
  CHECK(unknown < 3 * border);
  const cv::Mat tiny = rule_flow(scene.image(0)(cv::Rect(0, 0, 31, 40)).clone(),
                                 scene.image(1)(cv::Rect(0, 0, 31, 40)).clone(), true);
  CHECK(std::isnan(tiny.at<cv::Vec2f>(20, 20)[0]));
}

TEST_CASE("noise is interpolated between levels, and has limits") {
  std::uint32_t counts[256] = {};
  CHECK(geometry::noise_of(counts) == 1);
  counts[2] = 50;
  counts[3] = 50;
  CHECK(geometry::noise_of(counts) == Approx(1.4826 * 2.5));
  counts[0] = 1000;
  CHECK(geometry::noise_of(counts) == Approx(0.7));
  counts[200] = 100000;
  CHECK(geometry::noise_of(counts) == Approx(12));
}
