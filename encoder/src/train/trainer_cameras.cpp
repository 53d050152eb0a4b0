// SPDX-License-Identifier: Apache-2.0
// The schedule of the refinement of the cameras and of their times, and its result in the log.
#include <cmath>

#include "plural.h"
#include "train/camera_refinement.h"
#include "train/trainer.h"

namespace stgs::encoder {
namespace {

constexpr double kRefineFrom = 0.05;        // progress at which content is roughly in its place
constexpr std::uint64_t kViewsPerStep = 4;  // of a camera, on average
constexpr double kLastRate = 0.01;          // of the first one
constexpr std::size_t kMinCameras = 3, kMinTimedCameras = 2;

// A correction that is worth a warning, several times those of correct cameras.
constexpr double kWrongPixels = 1;
// A vignetting that is worth a warning, as a share of the brightness in the centre.
constexpr double kStrongVignetting = 0.1;
// A time shift that is worth a warning, frames.
constexpr double kWrongTime = 0.25;

}  // namespace

Status Trainer::prepare_cameras() {
  const bool refines = settings_.refine_cameras || settings_.refine_timing;
  if (!refines || !state_.cameras.empty()) return {};
  const std::size_t cameras = capture_.training_cameras().size();
  if (settings_.refine_timing && cameras < kMinTimedCameras) {
    return usage_error(
        "{}: --refine-timing needs at least {} training cameras, but there is {}; remove the "
        "option",
        capture_.folder, kMinTimedCameras, cameras);
  }
  if (settings_.refine_cameras && cameras < kMinCameras) {
    return usage_error(
        "{}: --refine-cameras needs at least {} training cameras, of which most are calibrated "
        "well, but there are {}; remove the option",
        capture_.folder, kMinCameras, cameras);
  }
  begin_refinement(cameras, state_);
  return {};
}

bool Trainer::refines_cameras() const {
  const double progress = growth_progress();
  return !state_.cameras.empty() && progress >= kRefineFrom && progress < 1;
}

void Trainer::use_cameras() {
  if (state_.cameras.empty()) return;
  images_.set_cameras(with_refined_cameras(capture_, state_).training_cameras());
}

Status Trainer::update_cameras() {
  if (!refines_cameras() || !passed(kViewsPerStep * state_.cameras.size())) return {};
  STGS_TRY(read_steps());
  const double decay = std::pow(kLastRate, growth_progress());
  CameraRates rates;
  if (settings_.refine_cameras) rates.geometry = static_cast<float>(parameters_.lr_camera * decay);
  if (settings_.refine_timing) rates.time = static_cast<float>(parameters_.lr_timing * decay);
  rates.pull = static_cast<float>(parameters_.camera_pull);
  encoder::update_cameras(capture_, rates, state_);
  use_cameras();
  return {};
}

void Trainer::warn_of_lens(const RefinedCamera& refined) const {
  if (refined.corner_pixels >= kWrongPixels) {
    log_(1, fmt::format("camera '{}': its lens distorts the corners of its images by {:.1f} "
                        "pixels; calibrate its distortion again",
                        refined.camera.name, refined.corner_pixels));
  }
  if (std::abs(refined.corner_brightness - 1) >= kStrongVignetting) {
    log_(1, fmt::format(
                "camera '{}': the corners of its images have {:.0f} % of the brightness in the "
                "centre, relative to most cameras; use the same lens and aperture for all "
                "cameras",
                refined.camera.name, 100 * refined.corner_brightness));
  }
}

void Trainer::warn_of_pose(const RefinedCamera& refined) const {
  if (refined.pixels < kWrongPixels) return;
  log_(1, fmt::format("camera '{}': its calibration was wrong by {:.1f} pixels ({:.2f} degrees, "
                      "{:.2f} % of its distance to the scene, {:.2f} % of its focal length); the "
                      "capture was prepared with it: calibrate the camera again, or check "
                      "whether it has moved",
                      refined.camera.name, refined.pixels, refined.degrees, 100 * refined.shift,
                      100 * std::abs(refined.zoom - 1)));
}

void Trainer::warn_of_time(const RefinedCamera& refined) const {
  if (std::abs(refined.time_shift) < kWrongTime) return;
  log_(1, fmt::format("camera '{}': its images were taken {:.2f} frames {} than stated; to prepare "
                      "the capture with their times, set its time_offset to {:.6f} in timing.json",
                      refined.camera.name, std::abs(refined.time_shift),
                      refined.time_shift > 0 ? "later" : "earlier", refined.time_offset));
}

void Trainer::report_cameras() const {
  const std::vector<RefinedCamera> cameras = refined_cameras(capture_, state_);
  if (cameras.empty()) return;
  double pixels = 0, shift = 0;
  for (const RefinedCamera& refined : cameras) {
    warn_of_lens(refined);
    warn_of_pose(refined);
    warn_of_time(refined);
    pixels += refined.pixels / static_cast<double>(cameras.size());
    shift += std::abs(refined.time_shift) / static_cast<double>(cameras.size());
  }
  const std::string count = plural(cameras.size(), "camera");
  if (settings_.refine_cameras)
    log_(2, fmt::format("{} refined, on average by {:.2f} pixels", count, pixels));
  if (settings_.refine_timing)
    log_(2, fmt::format("times of {} refined, on average by {:.3f} frames", count, shift));
}

}  // namespace stgs::encoder
