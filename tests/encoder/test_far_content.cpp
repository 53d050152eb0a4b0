// SPDX-License-Identifier: Apache-2.0
// Sky and far background, around a meadow and in rooms.
#include "init/far_content.h"

#include <cmath>
#include <functional>
#include <opencv2/imgproc.hpp>

#include "catch.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;

namespace {

constexpr int kViews = 8, kWidth = 160, kHeight = 120;
constexpr double kRing = 3, kFocal = 130, kFar = 120;

// Smooth noise of a position, 0 to 1.
double noise(const cv::Vec3d& p) {
  const auto value = [](int x, int y, int z) {
    std::uint32_t h = std::uint32_t(x) * 374761393u + std::uint32_t(y) * 668265263u +
                      std::uint32_t(z) * 2147483647u;
    h = (h ^ (h >> 13)) * 1274126177u;
    return double((h ^ (h >> 16)) & 0xffff) / 65535;
  };
  const int x = int(std::floor(p[0])), y = int(std::floor(p[1])), z = int(std::floor(p[2]));
  double sum = 0;
  for (int k = 0; k < 8; ++k) {
    const int dx = k & 1, dy = k >> 1 & 1, dz = k >> 2;
    const auto weight = [](double f, int upper) { return upper != 0 ? f : 1 - f; };
    sum += weight(p[0] - x, dx) * weight(p[1] - y, dy) * weight(p[2] - z, dz) *
           value(x + dx, y + dy, z + dz);
  }
  return sum;
}

struct Seen {
  cv::Vec3d colour;  // 0 to 255
  bool far = false;
};
using Scene = std::function<Seen(const cv::Vec3d& from, const cv::Vec3d& ray)>;

// Grass below, and a sky with a texture that fades upwards.
Seen meadow(const cv::Vec3d& from, const cv::Vec3d& ray) {
  if (ray[1] > 0) {
    const cv::Vec3d p = from + (1.5 - from[1]) / ray[1] * ray;
    return {cv::Vec3d(60, 110, 40) + 70 * noise(3 * p) * cv::Vec3d(1, 1, 1), false};
  }
  const double texture = std::max(0.0, 1 + 5 * ray[1]) * noise(18 * cv::normalize(ray));
  return {cv::Vec3d(120, 150, 200) + 50 * texture * cv::Vec3d(1, 1, 1), true};
}

// A room of 12 x 4 x 12 around the origin, with a texture on its walls of this strength.
Scene room(double strength) {
  return [strength](const cv::Vec3d& from, const cv::Vec3d& ray) -> Seen {
    const cv::Vec3d half(6, 2, 6);
    double distance = 1e300;
    for (int k = 0; k < 3; ++k) {
      const double wall = ray[k] > 0 ? half[k] : -half[k];
      if (ray[k] != 0) distance = std::min(distance, (wall - from[k]) / ray[k]);
    }
    return {cv::Vec3d(150, 140, 130) +
                strength * noise(2 * (from + distance * ray)) * cv::Vec3d(1, 1, 1),
            false};
  };
}

struct Rig {
  std::vector<Camera> cameras = std::vector<Camera>(kViews);
  std::vector<Surface> surfaces;
  std::vector<cv::Mat> usable, far;
};

// A ring of cameras that look at the origin; the true depth is confirmed in the lower `confirmed`
// rows.
Rig render_rig(const Scene& scene, int confirmed) {
  Rig rig;
  for (int k = 0; k < kViews; ++k) {
    const double angle = 2 * CV_PI * k / kViews;
    const cv::Vec3d z(-std::cos(angle), 0, -std::sin(angle)), y(0, 1, 0), x = y.cross(z);
    Camera& camera = rig.cameras[k];
    camera.fx = camera.fy = kFocal;
    View view;
    view.camera = &camera;
    view.width = kWidth;
    view.height = kHeight;
    view.fx = view.fy = kFocal;
    view.cx = 0.5 * kWidth;
    view.cy = 0.5 * kHeight;
    view.rotation = cv::Matx33d(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]);
    view.centre = -kRing * z;
    view.translation = -(view.rotation * view.centre);
    Surface surface{view, cv::Mat(view.size(), CV_8UC3), cv::Mat(view.size(), CV_32F, 1.0f),
                    cv::Mat(view.size(), CV_32F, cv::Scalar(0))};
    surface.normal = cv::Mat(view.size(), CV_32FC3, cv::Scalar(0));
    cv::Mat far(view.size(), CV_8U, cv::Scalar(0));
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const Seen seen = scene(view.centre, view.ray(u + 0.5, v + 0.5));
        surface.rgb.at<cv::Vec3b>(v, u) = cv::Vec3b(seen.colour);
        if (seen.far) far.at<std::uint8_t>(v, u) = 255;
      }
    }
    surface.weight.rowRange(kHeight - confirmed, kHeight).setTo(2);
    rig.surfaces.push_back(surface);
    rig.usable.emplace_back(view.size(), CV_8U, cv::Scalar(255));
    rig.far.push_back(far);
  }
  return rig;
}

bool place(Rig& rig) {
  const ProgressSink progress;
  const LogSink log = [](int, const std::string&) {};
  Work work(progress, log);
  const Result<bool> is_far =
      place_far_content(rig.usable, cv::Vec3d(0, 0, 0), kFar, 3, work, &rig.surfaces);
  REQUIRE(is_far.ok());
  return is_far.value();
}

}  // namespace

TEST_CASE("the sky above a meadow is far, and nothing else") {
  Rig rig = render_rig(meadow, kHeight / 2 - 6);
  REQUIRE(place(rig));
  for (int k = 0; k < kViews; ++k) {
    const Surface& surface = rig.surfaces[k];
    const cv::Mat found = surface.weight == 3;
    const double sky = cv::countNonZero(rig.far[k]);
    CHECK(cv::countNonZero(found & rig.far[k]) > 0.9 * sky);
    CHECK(cv::countNonZero(found & ~rig.far[k]) < 0.03 * sky);  // grass at the horizon
    const cv::Point middle(kWidth / 2, kHeight / 4);
    const cv::Vec3d p =
        surface.view.at(middle.x + 0.5, middle.y + 0.5, surface.depth.at<float>(middle));
    CHECK(cv::norm(p - surface.view.centre) / kFar > 0.999);
    const cv::Vec3d normal = surface.normal.at<cv::Vec3f>(middle);
    CHECK(normal.dot(cv::normalize(p - surface.view.centre)) < -0.999);
  }
}

TEST_CASE("confirmed and unusable pixels stay as they are") {
  Rig rig = render_rig(meadow, kHeight / 2 - 6);
  rig.surfaces[2].weight.setTo(2);
  rig.usable[5].setTo(0);
  place(rig);
  CHECK(cv::countNonZero(rig.surfaces[2].weight != 2) == 0);
  CHECK(cv::countNonZero(rig.surfaces[5].weight == 3) == 0);
  CHECK(cv::countNonZero(rig.surfaces[2].depth != 1) == 0);
  CHECK(cv::countNonZero(rig.surfaces[7].weight == 3) > 0);
}

TEST_CASE("walls are not far, with or without texture, nor is content of a single view") {
  const double strength = GENERATE(0.0, 20.0, 90.0);
  Rig rig = render_rig(room(strength), GENERATE(0, 30));
  CHECK_FALSE(place(rig));
  Rig single = render_rig(meadow, 0);
  single.surfaces.resize(1);
  CHECK_FALSE(place(single));
}
