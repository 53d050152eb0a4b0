// SPDX-License-Identifier: Apache-2.0
#include "init/findings.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <set>
#include <utility>

#include "median.h"
#include "plural.h"
#include "train/rig.h"

namespace stgs::encoder::init {
namespace {

constexpr double kFarAngle = 40;      // to the nearest camera, degrees
constexpr double kLittleDepth = 0.2;  // measured share of a background
constexpr double kExposureStops = 0.7;
constexpr double kGamma = 2.2;           // approximately that of the images
constexpr double kBlurRatio = 0.5;       // of the gradients of the other cameras
constexpr std::size_t kMinSamples = 60;  // points that a camera shares with two others
constexpr std::size_t kMaxPoints = 5000;
constexpr double kSameDepth = 0.03;  // relative

// The check of the calibration has logged its result.
void find_calibration(const std::vector<View>& views, const CalibrationCheck& calibration,
                      std::vector<Finding>* findings) {
  if (views.size() < kMinPairs) return;  // not checked
  const auto remedy_of = [](const Cause& cause, const char* otherwise) {
    return cause.remedy.empty() ? std::string(otherwise) : cause.remedy;
  };
  if (calibration.pairs < kMinPairs) {
    findings->push_back(
        {fmt::format("the calibration could not be checked: {} of cameras {} enough matches",
                     plural(calibration.pairs, "pair"), calibration.pairs == 1 ? "has" : "have"),
         "check by the images of the report that points of one object coincide in all cameras",
         true});
  } else if (!calibration.fits) {
    findings->push_back(
        {"the calibration does not fit the images",
         remedy_of(calibration.cause, "check the poses and intrinsics of all cameras"), true});
  }
  for (const Outlier& outlier : calibration.outliers) {
    findings->push_back({fmt::format("the calibration of camera '{}' disagrees with the others",
                                     views[std::size_t(outlier.view)].camera->name),
                         remedy_of(outlier.cause, "calibrate it again, or leave it out"), true});
  }
}

void find_timing(const std::vector<View>& views, const std::vector<LateCamera>& late,
                 std::vector<Finding>* findings) {
  for (const LateCamera& camera : late) {
    const bool is_late = camera.frames > 0;
    const std::string& name = views[std::size_t(camera.view)].camera->name;
    const std::string frames = plural(std::abs(camera.frames), "frame");
    findings->push_back(
        {fmt::format("camera '{}' is {} {} the others", name, frames,
                     is_late ? "later than" : "ahead of"),
         fmt::format("synchronise the cameras, remove the first {} of {}, or make the time_offset "
                     "of camera '{}' in timing.json {} {}",
                     frames, is_late ? "camera '" + name + "'" : std::string("all other cameras"),
                     name, frames, is_late ? "smaller" : "larger")});
  }
}

void find_missing_masks(const std::vector<View>& views, const std::vector<bool>& masked,
                        std::vector<Finding>* findings) {
  const auto given = static_cast<std::size_t>(std::count(masked.begin(), masked.end(), true));
  if (given == 0 || given == masked.size()) return;
  std::string names;
  for (std::size_t i = 0; i < masked.size(); ++i) {
    if (!masked[i])
      names += fmt::format("{}'{}'", names.empty() ? "" : ", ", views[i].camera->name);
  }
  findings->push_back(
      {fmt::format("masks were given for {} of {}, not for {}", given,
                   plural(masked.size(), "camera"), names),
       "provide masks for all training cameras in masks/CAMERA/, or for none; the others "
       "have motion masks, which may cover different content"});
}

void find_gaps(const std::vector<View>& views, const cv::Vec3d& focus,
               std::vector<Finding>* findings) {
  std::vector<RigPose> poses;
  poses.reserve(views.size());
  for (const View& view : views) poses.push_back(rig_pose(*view.camera));
  std::set<std::pair<std::size_t, std::size_t>> pairs;  // each is reported once
  for (std::size_t i = 0; i < poses.size(); ++i) {
    double nearest = 360;
    std::size_t neighbour = i;
    for (std::size_t j = 0; j < poses.size(); ++j) {
      const double angle = j == i ? 360 : rig_angle(poses[i], poses[j], focus.val);
      if (angle >= nearest) continue;
      nearest = angle;
      neighbour = j;
    }
    if (neighbour == i || nearest <= kFarAngle) continue;
    if (!pairs.insert(std::minmax(i, neighbour)).second) continue;
    const std::string& other = views[neighbour].camera->name;
    findings->push_back(
        {fmt::format("camera '{}' is {:.0f} degrees from the nearest one, '{}': content that no "
                     "other camera "
                     "sees has no depth, and views between them are guesses",
                     views[i].camera->name, nearest, other),
         fmt::format("add a camera between '{}' and '{}'", views[i].camera->name, other)});
  }
}

void find_unmeasured(const StaticScene& scene, std::vector<Finding>* findings) {
  for (std::size_t i = 0; i < scene.surfaces.size(); ++i) {
    const Surface& surface = scene.surfaces[i];
    const int background = cv::countNonZero(scene.usable[i]);
    if (background == 0) continue;
    const double share = double(cv::countNonZero(surface.weight > 0)) / background;
    if (share >= kLittleDepth) continue;
    findings->push_back(
        {fmt::format("only {:.0f} % of the background of camera '{}' has measured depth",
                     100 * share, surface.view.camera->name),
         "give plain walls and floors texture, or turn the camera towards content that other "
         "cameras see"});
  }
}

// The brightness of a point in one camera, in stops, and the logarithm of the gradient there.
struct Sample {
  std::size_t view;
  double brightness, gradient;
};

struct Grey {
  cv::Mat value, gradient;  // CV_32F
};

Grey grey_of(const Surface& surface) {
  cv::Mat grey, x, y;
  cv::cvtColor(surface.rgb, grey, cv::COLOR_RGB2GRAY);
  Grey out;
  grey.convertTo(out.value, CV_32F);
  cv::Sobel(out.value, x, CV_32F, 1, 0);
  cv::Sobel(out.value, y, CV_32F, 0, 1);
  cv::magnitude(x, y, out.gradient);
  return out;
}

std::vector<Sample> samples_of(const std::vector<Surface>& surfaces, const std::vector<Grey>& grey,
                               const SurfacePoint& point) {
  std::vector<Sample> samples;
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    const Pixel p = project(surfaces[i].view, point.position);
    if (!p.inside || surfaces[i].weight.at<float>(p.y(), p.x()) <= 0) continue;
    const double depth = surfaces[i].depth.at<float>(p.y(), p.x());
    if (std::abs(depth - p.depth) > kSameDepth * p.depth) continue;
    samples.push_back({i, kGamma * std::log2(1.0 + grey[i].value.at<float>(p.y(), p.x())),
                       std::log2(1.0 + grey[i].gradient.at<float>(p.y(), p.x()))});
  }
  return samples;
}

// Compares how cameras see the same points: each with the mean of the others.
void find_photometry(const std::vector<Surface>& surfaces, const std::vector<SurfacePoint>& points,
                     std::vector<Finding>* findings) {
  std::vector<Grey> grey;
  grey.reserve(surfaces.size());
  for (const Surface& surface : surfaces) grey.push_back(grey_of(surface));
  std::vector<std::vector<double>> brightness(surfaces.size()), gradient(surfaces.size());
  const std::size_t stride = points.size() / kMaxPoints + 1;
  for (std::size_t k = 0; k < points.size(); k += stride) {
    const std::vector<Sample> samples = samples_of(surfaces, grey, points[k]);
    if (samples.size() < 3) continue;
    double sum = 0, slopes = 0;
    for (const Sample& s : samples) {
      sum += s.brightness;
      slopes += s.gradient;
    }
    const auto others = double(samples.size() - 1);
    for (const Sample& s : samples) {
      brightness[s.view].push_back(s.brightness - (sum - s.brightness) / others);
      gradient[s.view].push_back(s.gradient - (slopes - s.gradient) / others);
    }
  }
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    if (brightness[i].size() < kMinSamples) continue;
    const std::string& name = surfaces[i].view.camera->name;
    if (const double stops = median_value(brightness[i]); std::abs(stops) > kExposureStops) {
      findings->push_back({fmt::format("camera '{}' is {:.1f} stops {} than the others", name,
                                       std::abs(stops), stops > 0 ? "brighter" : "darker"),
                           "lock exposure, gain and white balance to the same values; training "
                           "corrects a constant difference"});
    }
    if (median_value(gradient[i]) < std::log2(kBlurRatio)) {
      findings->push_back({fmt::format("camera '{}' is less sharp than the others", name),
                           "check its focus and shutter time"});
    }
  }
}

}  // namespace

std::vector<Finding> find_weaknesses(const std::vector<View>& views, const StaticScene& scene,
                                     const CalibrationCheck& calibration,
                                     const std::vector<LateCamera>& late,
                                     const std::vector<bool>& masked,
                                     const std::vector<SurfacePoint>& points) {
  std::vector<Finding> findings;
  find_calibration(views, calibration, &findings);
  find_timing(views, late, &findings);
  find_missing_masks(views, masked, &findings);
  find_gaps(views, scene.focus.point, &findings);
  if (views.size() > 1) find_unmeasured(scene, &findings);
  find_photometry(scene.surfaces, points, &findings);
  return findings;
}

}  // namespace stgs::encoder::init
