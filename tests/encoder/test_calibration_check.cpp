// SPDX-License-Identifier: Apache-2.0
// Disagreement between a calibration and matches, with the matches of random points in a ring of
// cameras.
#include <functional>
#include <opencv2/calib3d.hpp>
#include <random>
#include <string>
#include <vector>

#include "catch.h"
#include "init/calibration_check.h"

using namespace stgs::encoder;
using namespace stgs::encoder::init;

namespace {

constexpr int kCameras = 10;
constexpr double kNoise = 0.2;  // pixels

View look(const cv::Vec3d& from, const cv::Vec3d& at) {
  View view;
  view.width = 640;
  view.height = 480;
  view.fx = view.fy = 500;
  view.cx = 320;
  view.cy = 240;
  const cv::Vec3d z = cv::normalize(at - from);
  const cv::Vec3d x = cv::normalize(cv::Vec3d(0, -1, 0.1).cross(z)), y = z.cross(x);
  view.rotation = {x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]};
  view.centre = from;
  view.translation = -(view.rotation * from);
  return view;
}

// Cameras on an arc around the origin, at different heights.
std::vector<View> ring() {
  std::vector<View> out;
  for (int i = 0; i < kCameras; ++i) {
    const double angle = 0.35 * i;
    out.push_back(look({4 * std::cos(angle), 0.3 * (i % 3), 4 * std::sin(angle)}, {0.1, 0, 0.2}));
  }
  return out;
}

// The matches of random points between cameras that are next to each other or at one remove.
// `scene`: a point from three numbers in [-1,1]. `wrong`: matches per pair that lie along the
// epipolar line, somewhere else.
std::vector<PairMatches> matches_of(
    const std::vector<View>& views,
    const std::function<cv::Vec3d(const cv::Vec3d&)>& scene = [](const cv::Vec3d& v) { return v; },
    int wrong = 0, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::normal_distribution<double> noise(0, kNoise);
  const int cameras = static_cast<int>(views.size());
  std::vector<PairMatches> out;
  for (int a = 0; a < cameras; ++a) {
    for (int b = a + 1; b < std::min(a + 3, cameras); ++b) {
      PairMatches& pair = out.emplace_back();
      pair.a = a;
      pair.b = b;
      while (pair.in_a.size() < 40) {
        const cv::Vec3d point = scene({uniform(random), uniform(random), uniform(random)});
        const Pixel p = project(views[a], point);
        Pixel q = project(views[b], point);
        if (static_cast<int>(pair.in_a.size()) < wrong) q.u += 100 * uniform(random);
        if (!p.inside || !q.inside) continue;
        pair.in_a.emplace_back(p.u + noise(random), p.v + noise(random));
        pair.in_b.emplace_back(q.u + noise(random), q.v + noise(random));
      }
    }
  }
  return out;
}

View moved(View view, const cv::Matx33d& rotation, const cv::Vec3d& translation) {
  view.rotation = rotation;
  view.translation = translation;
  view.centre = -(rotation.t() * translation);
  return view;
}

struct Case {
  std::string text;  // a part of the cause
  std::function<View(const View&)> mistake;
};

const cv::Matx33d kFlip(1, 0, 0, 0, -1, 0, 0, 0, -1);
const std::vector<Case> kCases = {
    {"the poses are inverted",
     [](const View& v) { return moved(v, v.rotation.t(), -(v.rotation.t() * v.translation)); }},
    {"the cameras have OpenGL's axes",
     [](const View& v) { return moved(v, kFlip * v.rotation, kFlip * v.translation); }},
    {"rotations are transposed",
     [](const View& v) { return moved(v, v.rotation.t(), v.translation); }},
    {"images of half the size",
     [](View v) {
       v.fx *= 0.5, v.fy *= 0.5, v.cx *= 0.5, v.cy *= 0.5;
       return v;
     }},
    {"images of twice the size",
     [](View v) {
       v.fx *= 2, v.fy *= 2, v.cx *= 2, v.cy *= 2;
       return v;
     }},
};

}  // namespace

TEST_CASE("calibration check: a correct calibration fits", "[calibration_check]") {
  const std::vector<View> views = ring();
  const CalibrationCheck check = check_calibration(views, matches_of(views));
  CHECK(check.fits);
  CHECK(check.cause.text.empty());
  CHECK(check.outliers.empty());
  CHECK(check.error < 2 * kNoise);
  CHECK(check.pairs == 17);
}

TEST_CASE("calibration check: views without parallax give no false alarm", "[calibration_check]") {
  const auto far = [](const cv::Vec3d& v) {
    const double depth = 95 + 55 * v[2];
    return cv::Vec3d(0.5 * depth * v[0], 0.4 * depth * v[1], depth);
  };
  for (const int cameras : {3, 4, 6, 10}) {
    for (unsigned seed = 1; seed <= 20; ++seed) {
      for (const double step : {0.05, 0.0005}) {  // a row, and almost one position
        std::vector<View> views;
        for (int i = 0; i < cameras; ++i) views.push_back(look({step * i, 0, 0}, {step * i, 0, 1}));
        const CalibrationCheck check =
            check_calibration(views, matches_of(views, far, 1 + static_cast<int>(seed % 4), seed));
        CAPTURE(cameras, seed, step, check.error, check.cause.text);
        CHECK(check.fits);
        CHECK(check.outliers.empty());
      }
    }
  }
}

TEST_CASE("calibration check: mistakes of all cameras are named", "[calibration_check]") {
  const std::vector<View> views = ring();
  const std::vector<PairMatches> pairs = matches_of(views);
  for (const Case& one : kCases) {
    std::vector<View> given;
    for (const View& view : views) given.push_back(one.mistake(view));
    const CalibrationCheck check = check_calibration(given, pairs);
    CAPTURE(one.text, check.error, check.cause.text);
    CHECK_FALSE(check.fits);
    CHECK(check.cause.text.find(one.text) != std::string::npos);
    CHECK(check.cause.error < 2 * kNoise);
  }
}

TEST_CASE("calibration check: mistakes of one camera are named", "[calibration_check]") {
  const std::vector<View> views = ring();
  const std::vector<PairMatches> pairs = matches_of(views);
  std::vector<Case> cases = kCases;
  cases.push_back({"the position is in mm, those of the others in m",
                   [](const View& v) { return moved(v, v.rotation, 1000 * v.translation); }});
  for (const Case& one : cases) {
    std::vector<View> given = views;
    given[4] = one.mistake(views[4]);
    const CalibrationCheck check = check_calibration(given, pairs);
    CAPTURE(one.text, check.error);
    CHECK(check.fits);
    CHECK(check.error < 2 * kNoise);
    REQUIRE(check.outliers.size() == 1);
    CHECK(check.outliers[0].view == 4);
    CHECK((check.outliers[0].error > 5 || check.outliers[0].is_behind));
    CHECK(check.outliers[0].cause.text.find(one.text) != std::string::npos);
  }
}

TEST_CASE("calibration check: cameras that have moved are named", "[calibration_check]") {
  const std::vector<View> views = ring();
  const std::vector<PairMatches> pairs = matches_of(views);
  std::vector<View> given = views;
  for (const int i : {1, 4, 8}) {
    cv::Matx33d turn;
    cv::Rodrigues(cv::Vec3d(0.008, 0.003, 0.002), turn);  // half a degree
    given[i] = moved(views[i], turn * views[i].rotation, turn * views[i].translation);
  }
  const CalibrationCheck check = check_calibration(given, pairs);
  CHECK(check.fits);
  CHECK(check.error < 2 * kNoise);
  std::vector<int> found;
  for (const Outlier& outlier : check.outliers) {
    found.push_back(outlier.view);
    CHECK(outlier.cause.text.empty());
    CHECK(outlier.error > 1);
  }
  std::sort(found.begin(), found.end());
  CHECK(found == std::vector<int>{1, 4, 8});
}

TEST_CASE("calibration check: matches of similar objects are no mistake of a camera",
          "[calibration_check]") {
  const std::vector<View> views = ring();
  std::vector<PairMatches> pairs = matches_of(views);
  // In the pairs of two cameras, matches with other objects, which no pose explains.
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-4, 4);
  for (PairMatches& pair : pairs) {
    if (pair.a == 3 || pair.b == 3 || pair.a == 6 || pair.b == 6) {
      for (cv::Point2d& p : pair.in_b) p += cv::Point2d(uniform(random), uniform(random));
    }
  }
  const CalibrationCheck check = check_calibration(views, pairs);
  CHECK(check.fits);
  CHECK(check.outliers.empty());
}

TEST_CASE(
    "calibration check: matches far from the lines name a camera unless it agrees with another",
    "[calibration_check]") {
  const std::vector<View> views = ring();
  const bool agrees_with_one = GENERATE(false, true);
  std::vector<PairMatches> pairs = matches_of(views);
  // Matches with other objects in the pairs of a camera, which no pose explains.
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-200, 200);
  for (PairMatches& pair : pairs) {
    if ((pair.a != 4 && pair.b != 4) || (agrees_with_one && pair.a == 3)) continue;
    for (cv::Point2d& p : pair.in_b) p += cv::Point2d(uniform(random), uniform(random));
  }
  const CalibrationCheck check = check_calibration(views, pairs);
  CHECK(check.fits);
  REQUIRE(check.outliers.size() == (agrees_with_one ? 0 : 1));
  if (!agrees_with_one) CHECK(check.outliers[0].view == 4);
}

TEST_CASE("calibration check: a few wrong matches do not name a camera", "[calibration_check]") {
  const std::vector<View> views = ring();
  std::vector<PairMatches> pairs = matches_of(views);
  // Imprecise matches with one camera, and a few wrong ones with three others.
  std::mt19937 random(5);
  std::uniform_real_distribution<double> near(-2, 2), far(-200, 200);
  for (PairMatches& pair : pairs) {
    if (pair.a != 4 && pair.b != 4) continue;
    const bool is_near = pair.a == 3;
    if (!is_near) pair.in_a.resize(10), pair.in_b.resize(10);
    for (cv::Point2d& p : pair.in_b)
      p +=
          is_near ? cv::Point2d(near(random), near(random)) : cv::Point2d(far(random), far(random));
  }
  const CalibrationCheck check = check_calibration(views, pairs);
  CHECK(check.fits);
  CHECK(check.outliers.empty());
}

TEST_CASE("calibration check: a moved camera is named although it agrees with another",
          "[calibration_check]") {
  const std::vector<View> views = ring();
  std::vector<View> given = views;
  cv::Matx33d turn;
  cv::Rodrigues(cv::Vec3d(0.04, 0.03, 0.02), turn);
  given[4] = moved(views[4], turn * views[4].rotation, turn * views[4].translation);
  std::vector<PairMatches> pairs = matches_of(views);
  const std::vector<PairMatches> wrong = matches_of(given);
  for (std::size_t i = 0; i < pairs.size(); ++i)
    if (pairs[i].a == 3 && pairs[i].b == 4) pairs[i] = wrong[i];
  const CalibrationCheck check = check_calibration(given, pairs);
  REQUIRE(check.outliers.size() == 1);
  CHECK(check.outliers[0].view == 4);
  CHECK(check.outliers[0].error > 5);
}

// Some turns and shifts of this size keep most matches near their epipolar lines.
TEST_CASE("calibration check: nine of ten cameras that moved by half a degree and 1 % are named",
          "[calibration_check]") {
  constexpr int kTries = 60;
  const std::vector<View> views = ring();
  const std::vector<PairMatches> pairs = matches_of(views);
  int named = 0;
  for (int i = 0; i < kTries; ++i) {
    std::mt19937 random(static_cast<unsigned>(i));
    std::normal_distribution<double> normal;
    const cv::Vec3d axis = cv::normalize(cv::Vec3d(normal(random), normal(random), normal(random)));
    const cv::Vec3d along(normal(random), normal(random), normal(random));
    cv::Matx33d turn;
    cv::Rodrigues(0.0087 * axis, turn);
    std::vector<View> given = views;
    given[4] = moved(views[4], turn * views[4].rotation,
                     turn * views[4].translation + 0.04 * cv::normalize(along));
    const CalibrationCheck check = check_calibration(given, pairs);
    REQUIRE(check.outliers.size() <= 1);
    if (check.outliers.empty()) continue;
    CHECK(check.outliers[0].view == 4);
    ++named;
  }
  CHECK(named >= 0.9 * kTries);
}

TEST_CASE("calibration check: too few pairs give no verdict", "[calibration_check]") {
  const std::vector<View> views = ring();
  std::vector<PairMatches> pairs = matches_of(views);
  pairs.resize(kMinPairs - 1);
  std::vector<View> given;
  for (const View& view : views) given.push_back(kCases[0].mistake(view));
  const CalibrationCheck check = check_calibration(given, pairs);
  CHECK(check.fits);
  CHECK(check.outliers.empty());
}
