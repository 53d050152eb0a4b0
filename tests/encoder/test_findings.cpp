// SPDX-License-Identifier: Apache-2.0
// The findings of the report of a prepared capture, on views of a textured plane.
#include "init/findings.h"

#include <opencv2/imgproc.hpp>

#include "catch.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;

namespace {

constexpr int kWidth = 160, kHeight = 120;
constexpr double kDistance = 4;

struct Rig {
  std::vector<Camera> cameras;
  std::vector<View> views;
  StaticScene scene;
  CalibrationCheck calibration;
  std::vector<LateCamera> late;
  std::vector<bool> masked;
  std::vector<SurfacePoint> points;

  std::vector<Finding> findings() const {
    return find_weaknesses(views, scene, calibration, late, masked, points);
  }
};

std::uint8_t texture(double x, double y) {
  return std::uint8_t(120 + 50 * std::sin(9 * x) * std::cos(7 * y) +
                      20 * std::sin(23 * x + 17 * y));
}

// Cameras next to each other, `spacing` apart, that look along z at the plane z = kDistance.
Rig rig(int count, double spacing) {
  Rig rig;
  for (int i = 0; i < count; ++i) {
    Camera camera;
    camera.name = "cam" + std::to_string(i);
    camera.width = kWidth;
    camera.height = kHeight;
    camera.fx = camera.fy = 150;
    camera.cx = 0.5 * kWidth;
    camera.cy = 0.5 * kHeight;
    camera.translation[0] = -spacing * i;
    rig.cameras.push_back(camera);
  }
  for (const Camera& camera : rig.cameras) {
    const View view = make_view(camera, kWidth);
    Surface surface{view, cv::Mat(kHeight, kWidth, CV_8UC3),
                    cv::Mat(kHeight, kWidth, CV_32F, cv::Scalar(kDistance)),
                    cv::Mat(kHeight, kWidth, CV_32F, cv::Scalar(1))};
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const cv::Vec3d p = view.at(x + 0.5, y + 0.5, kDistance);
        surface.rgb.at<cv::Vec3b>(y, x) = cv::Vec3b::all(texture(p[0], p[1]));
      }
    }
    rig.views.push_back(view);
    rig.scene.surfaces.push_back(surface);
    rig.scene.usable.emplace_back(kHeight, kWidth, CV_8U, cv::Scalar(255));
  }
  for (int k = 0; k < 400; ++k) {
    rig.points.push_back(
        {cv::Vec3d(0.05 * (k % 20) + 0.2, 0.04 * (k / 20) - 0.4, kDistance), cv::Vec3b::all(120)});
  }
  rig.scene.focus.point = cv::Vec3d(0.5 * spacing * (count - 1), 0, kDistance);
  rig.scene.focus.depth = kDistance;
  rig.calibration.pairs = 6;
  return rig;
}

bool mentions(const std::vector<Finding>& findings, const std::string& text) {
  for (const Finding& finding : findings) {
    if (finding.text.find(text) != std::string::npos) {
      CHECK_FALSE(finding.remedy.empty());
      return true;
    }
  }
  return false;
}

}  // namespace

TEST_CASE("a late camera is a finding, and one ahead of the others, too") {
  Rig capture = rig(4, 0.4);
  CHECK_FALSE(mentions(capture.findings(), "later than"));
  capture.late = {{1, 2}, {3, -1}};
  CHECK(mentions(capture.findings(), "camera 'cam1' is 2 frames later than the others"));
  CHECK(mentions(capture.findings(), "camera 'cam3' is 1 frame ahead of the others"));
}

TEST_CASE("cameras without masks are named if others have some") {
  Rig capture = rig(4, 0.4);
  for (const bool all : {false, true}) {
    capture.masked.assign(4, all);
    CHECK(capture.findings().empty());
  }
  capture.masked = {true, false, true, false};
  CHECK(
      mentions(capture.findings(), "masks were given for 2 of 4 cameras, not for 'cam1', 'cam3'"));
}

TEST_CASE("a sound capture has no findings") {
  CHECK(rig(4, 0.4).findings().empty());
}

TEST_CASE("cameras far from the others, and those between which one is missing, are named") {
  Rig capture = rig(3, 0.4);
  // Turned by 90 degrees: it looks along x.
  const double rotation[9] = {0, 0, -1, 0, 1, 0, 1, 0, 0};
  std::copy_n(rotation, 9, capture.cameras[2].rotation);
  const std::vector<Finding> findings = capture.findings();
  REQUIRE(findings.size() == 1);
  CHECK(mentions(findings, "camera 'cam2' is 90 degrees from the nearest one, 'cam"));
}

TEST_CASE("exposure and blur are found by points that several cameras see") {
  Rig capture = rig(4, 0.4);
  cv::Mat& bright = capture.scene.surfaces[1].rgb;
  bright.convertTo(bright, -1, 1.4);
  cv::Mat& blurred = capture.scene.surfaces[3].rgb;
  cv::GaussianBlur(blurred, blurred, {0, 0}, 6);
  const std::vector<Finding> findings = capture.findings();
  CHECK(findings.size() == 2);
  CHECK(mentions(findings, "camera 'cam1' is 1."));
  CHECK(mentions(findings, "camera 'cam3' is less sharp"));
}

TEST_CASE("moving content is no background without depth") {
  Rig capture = rig(4, 0.4);
  for (const int k : {1, 2}) {
    cv::Mat performer = capture.scene.usable[k](cv::Rect(0, 0, kWidth, kHeight - 10));
    performer.setTo(0);
    capture.scene.surfaces[k].weight(cv::Rect(0, 0, kWidth, kHeight - 10)).setTo(0);
  }
  CHECK_FALSE(mentions(capture.findings(), "has measured depth"));
}

TEST_CASE("missing depth and a calibration that was not checked are reported") {
  Rig capture = rig(4, 0.4);
  capture.scene.surfaces[2].weight.setTo(0);
  capture.calibration.pairs = 1;
  const std::vector<Finding> findings = capture.findings();
  CHECK(mentions(findings, "only 0 % of the background of camera 'cam2' has measured depth"));
  CHECK(mentions(findings, "the calibration could not be checked: 1 pair"));
  CHECK_FALSE(mentions(findings, "does not fit"));
  capture.calibration.pairs = 6;
  capture.calibration.fits = false;
  CHECK(mentions(capture.findings(), "the calibration does not fit the images"));
  capture.calibration.fits = true;
  capture.calibration.outliers.push_back({1, 9.0, false, {"", "", 0}});
  CHECK(mentions(capture.findings(), "the calibration of camera 'cam1' disagrees"));
}
