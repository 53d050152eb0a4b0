// SPDX-License-Identifier: Apache-2.0
#include "train/camera_refinement.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "median.h"
#include "train/adam.h"
#include "train/rig.h"

namespace stgs::encoder {
namespace {

// Rates of the lens, over that of angles, so that the steps of a run reach common lenses.
constexpr double kDistortionRate = 4, kVignettingRate = 30;

// A run has tens of steps of a camera, of which each uses several views.
constexpr AdamBetas kBetas = {0.9f, 0.99f};

double length(double x, double y, double z) {
  return std::sqrt(x * x + y * y + z * z);
}

double turn_of(const CameraCorrection& c) {
  return length(c[kTurn], c[kTurn + 1], c[kTurn + 2]);
}

// Turns a vector by |w| radians around w (Rodrigues).
void turn(const CameraCorrection& w, const double v[3], double out[3]) {
  const double angle = turn_of(w);
  const double x = w[kTurn], y = w[kTurn + 1], z = w[kTurn + 2];
  const double s = angle > 1e-9 ? std::sin(angle) / angle : 1.0;
  const double c = angle > 1e-9 ? (1.0 - std::cos(angle)) / (angle * angle) : 0.5;
  const double cross[3] = {y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]};
  const double twice[3] = {y * cross[2] - z * cross[1], z * cross[0] - x * cross[2],
                           x * cross[1] - y * cross[0]};
  for (int k = 0; k < 3; ++k) out[k] = v[k] + s * cross[k] + c * twice[k];
}

void limit(float& value, float most) {
  value = std::clamp(value, -most, most);
}

// Shortens a vector by a length, or to 0.
void shorten(float* v, std::size_t count, double by) {
  double square = 0;
  for (std::size_t k = 0; k < count; ++k) square += double{v[k]} * v[k];
  const double before = std::sqrt(square);
  const auto factor = static_cast<float>(before > by ? 1.0 - by / before : 0.0);
  for (std::size_t k = 0; k < count; ++k) v[k] *= factor;
}

double distance(const double a[3], const double b[3]) {
  return length(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

double scene_distance(const PreparedCapture& capture, const Camera& camera) {
  return distance(rig_pose(camera).centre, capture.scene_centre);
}

using Vector = std::array<double, 3>;

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// Returns the medians of the coordinates.
Vector medians_of(const std::vector<Vector>& vectors) {
  Vector out;
  for (std::size_t k = 0; k < 3; ++k) {
    std::vector<double> values;
    for (const Vector& v : vectors) values.push_back(v[k]);
    out[k] = median_value(std::move(values));
  }
  return out;
}

Vector position_of(const Camera& camera, const PreparedCapture& capture) {
  const RigPose pose = rig_pose(camera);
  return {pose.centre[0] - capture.scene_centre[0], pose.centre[1] - capture.scene_centre[1],
          pose.centre[2] - capture.scene_centre[2]};
}

// A motion of the world around the centre of the scene, small, with a change of size:
// x becomes x + turn x x + shift + growth x.
struct CommonMotion {
  Vector turn{}, shift{};
  double growth = 0, log_focal = 0;
  double distortion = 0, vignetting = 0;  // that most lenses share
};

// Returns the motion that most cameras share by their corrections: medians over the cameras.
CommonMotion common_motion(const PreparedCapture& capture, const std::vector<Camera>& cameras,
                           const std::vector<CameraCorrection>& corrections) {
  CommonMotion common;
  std::vector<Vector> turns, shifts;
  std::vector<double> growths, zooms, distortions, vignettings;
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const double* r = cameras[c].rotation;
    const CameraCorrection& w = corrections[c];
    Vector turn;  // the world turns the other way
    for (std::size_t k = 0; k < 3; ++k)
      turn[k] = -(r[k] * w[0] + r[3 + k] * w[1] + r[6 + k] * w[2]);
    turns.push_back(turn);
    zooms.push_back(w[kLogFocal]);
    distortions.push_back(w[kDistortion]);
    vignettings.push_back(w[kVignetting]);
  }
  common.turn = medians_of(turns);
  common.log_focal = median_value(std::move(zooms));
  common.distortion = median_value(std::move(distortions));
  common.vignetting = median_value(std::move(vignettings));
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const Vector from = position_of(cameras[c], capture);
    const Vector to = position_of(corrected(cameras[c], corrections[c]), capture);
    const Vector turned = cross(common.turn, from);
    shifts.push_back(
        {to[0] - from[0] - turned[0], to[1] - from[1] - turned[1], to[2] - from[2] - turned[2]});
  }
  common.shift = medians_of(shifts);
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const Vector from = position_of(cameras[c], capture);
    double along = 0, square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      along += (shifts[c][k] - common.shift[k]) * from[k];
      square += from[k] * from[k];
    }
    growths.push_back(square > 0 ? along / square : 0);
  }
  common.growth = median_value(std::move(growths));
  return common;
}

// Removes a small common motion from a correction.
void remove_motion(const PreparedCapture& capture, const Camera& camera, const CommonMotion& common,
                   CameraCorrection& correction) {
  const Camera before = corrected(camera, correction);
  const Vector at = position_of(before, capture), turned = cross(common.turn, at);
  const double* r = camera.rotation;
  for (std::size_t k = 0; k < 3; ++k) {
    const double* row = r + 3 * k;
    correction[kTurn + k] += static_cast<float>(row[0] * common.turn[0] + row[1] * common.turn[1] +
                                                row[2] * common.turn[2]);
  }
  correction[kLogFocal] -= static_cast<float>(common.log_focal);
  correction[kDistortion] -= static_cast<float>(common.distortion);
  correction[kVignetting] -= static_cast<float>(common.vignetting);
  // The shift that puts the centre where it is without the motion.
  const Camera after = corrected(camera, correction);
  for (std::size_t k = 0; k < 3; ++k) {
    const double* row = after.rotation + 3 * k;
    double shift = -(after.translation[k] - double{correction[kShift + k]});
    for (std::size_t j = 0; j < 3; ++j) {
      const double centre =
          capture.scene_centre[j] + at[j] - turned[j] - common.shift[j] - common.growth * at[j];
      shift -= row[j] * centre;
    }
    correction[kShift + k] = static_cast<float>(shift);
  }
}

// Most cameras are right, so that a motion of most of them is not a correction.
void undo_common_motion(const PreparedCapture& capture, const std::vector<Camera>& cameras,
                        std::vector<CameraCorrection>& corrections) {
  const CommonMotion common = common_motion(capture, cameras, corrections);
  for (std::size_t c = 0; c < cameras.size(); ++c)
    remove_motion(capture, cameras[c], common, corrections[c]);
}

// If all images were later by the same time, the scene would only begin earlier.
void undo_common_time_shift(std::vector<CameraCorrection>& corrections) {
  std::vector<double> shifts;
  for (const CameraCorrection& correction : corrections) shifts.push_back(correction[kTimeShift]);
  const auto common = static_cast<float>(median_value(std::move(shifts)));
  for (CameraCorrection& correction : corrections) correction[kTimeShift] -= common;
}

// Returns the root mean square distance in pixels between the projections by two cameras of points
// around the centre of the scene.
double displacement(const PreparedCapture& capture, const Camera& before, const Camera& after) {
  const math::PinholeCamera cameras[2] = {before.pinhole(0.0f), after.pinhole(0.0f)};
  double square = 0;
  int points = 0;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-0.5, 0.0, 0.5}) {
      double p[3];
      std::copy_n(capture.scene_centre, 3, p);
      p[axis] += side * capture.scene_radius;
      math::Vec2 at[2];
      bool visible = true;
      for (int k = 0; k < 2; ++k) {
        const math::PinholeCamera& camera = cameras[k];
        const math::Vec3 c = math::to_camera(
            camera, {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
        visible = visible && c.z > 0.1 * capture.scene_radius;
        at[k] = {camera.fx * c.x / c.z, camera.fy * c.y / c.z};
      }
      if (!visible) continue;
      square += std::pow(at[1].x - at[0].x, 2) + std::pow(at[1].y - at[0].y, 2);
      ++points;
    }
  }
  return points > 0 ? std::sqrt(square / points) : 0;
}

// Returns the distance in pixels by which a distortion moves content in the corners of an image.
double corner_displacement(const Camera& camera, double distortion) {
  const double x = 0.5 * camera.width / camera.fx, y = 0.5 * camera.height / camera.fy;
  return std::abs(distortion) * (x * x + y * y) *
         std::hypot(0.5 * camera.width, 0.5 * camera.height);
}

}  // namespace

Camera corrected(const Camera& camera, const CameraCorrection& correction) {
  Camera out = camera;
  for (int column = 0; column < 3; ++column) {
    const double axis[3] = {camera.rotation[column], camera.rotation[3 + column],
                            camera.rotation[6 + column]};
    double turned[3];
    turn(correction, axis, turned);
    for (int row = 0; row < 3; ++row) out.rotation[3 * row + column] = turned[row];
  }
  turn(correction, camera.translation, out.translation);
  for (int k = 0; k < 3; ++k) out.translation[k] += double{correction[kShift + k]};
  const double zoom = std::exp(double{correction[kLogFocal]});
  out.fx *= zoom;
  out.fy *= zoom;
  out.time_shift = double{correction[kTimeShift]};
  return out;
}

math::Lens lens_of(const CameraCorrection& correction) {
  return {correction[kDistortion], correction[kVignetting]};
}

PreparedCapture with_refined_cameras(const PreparedCapture& capture, const TrainState& state) {
  PreparedCapture out = capture;
  std::size_t index = 0;
  for (Camera& camera : out.cameras) {
    if (!camera.test && !state.cameras.empty()) camera = corrected(camera, state.cameras[index++]);
  }
  return out;
}

void begin_refinement(std::size_t cameras, TrainState& state) {
  for (auto* values :
       {&state.cameras, &state.cameras_first, &state.cameras_second, &state.camera_sums})
    values->assign(cameras, {});
  state.camera_updates.assign(cameras, 0);
  state.camera_views.assign(cameras, 0);
}

void add_camera_gradient(TrainState& state, std::size_t camera, const math::CameraGrad& gradient,
                         float vignetting) {
  const math::Vec3 r = gradient.rotation, t = gradient.translation;
  const CameraCorrection view = {
      r.x,        r.y,          r.z, t.x, t.y, t.z, gradient.log_focal, gradient.distortion,
      vignetting, gradient.time};
  CameraCorrection& sum = state.camera_sums[camera];
  for (std::size_t k = 0; k < view.size(); ++k) sum[k] += view[k];
  ++state.camera_views[camera];
}

void update_cameras(const PreparedCapture& capture, const CameraRates& rates, TrainState& state) {
  const std::vector<Camera> cameras = capture.training_cameras();
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    CameraCorrection gradient = std::exchange(state.camera_sums[c], CameraCorrection{});
    const std::uint32_t views = std::exchange(state.camera_views[c], 0u);
    if (views == 0) continue;
    for (float& g : gradient) g /= static_cast<float>(views);
    CameraCorrection& camera = state.cameras[c];
    const AdamCorrection bias(++state.camera_updates[c], kBetas);
    const auto step = [&](std::size_t at, std::size_t count, double by, double pull) {
      adam_step(&camera[at], &state.cameras_first[c][at], &state.cameras_second[c][at],
                &gradient[at], count, static_cast<float>(by), bias, kBetas);
      shorten(&camera[at], count, by * pull);
    };
    const double rate = rates.geometry, pull = rates.pull;
    if (rate > 0) {
      step(kTurn, 3, rate, pull);
      step(kShift, 3, rate * scene_distance(capture, cameras[c]), pull);
      step(kLogFocal, 1, rate, pull);
      step(kDistortion, 1, kDistortionRate * rate, pull);
      step(kVignetting, 1, kVignettingRate * rate, pull);
    }
    // Without a pull: a rig without synchronisation has no times to keep.
    if (rates.time > 0) step(kTimeShift, 1, rates.time, 0);
  }
  if (rates.geometry > 0) undo_common_motion(capture, cameras, state.cameras);
  undo_common_time_shift(state.cameras);
  for (CameraCorrection& camera : state.cameras) {
    limit(camera[kDistortion], kMaxDistortion);
    limit(camera[kVignetting], kMaxVignetting);
    limit(camera[kTimeShift], kMaxTimeShift);
  }
}

std::vector<RefinedCamera> refined_cameras(const PreparedCapture& capture,
                                           const TrainState& state) {
  std::vector<RefinedCamera> refined;
  if (state.cameras.empty()) return refined;
  const PreparedCapture after = with_refined_cameras(capture, state);
  for (std::size_t i = 0; i < capture.cameras.size(); ++i) {
    if (capture.cameras[i].test) continue;
    const std::size_t index = refined.size();
    RefinedCamera& out = refined.emplace_back();
    out.camera = after.cameras[i];
    out.degrees = turn_of(state.cameras[index]) * 180 / std::numbers::pi;
    const RigPose from = rig_pose(capture.cameras[i]), to = rig_pose(out.camera);
    const double away = scene_distance(capture, capture.cameras[i]);
    out.shift = away > 0 ? distance(from.centre, to.centre) / away : 0;
    out.zoom = std::exp(double{state.cameras[index][kLogFocal]});
    out.pixels = displacement(capture, capture.cameras[i], out.camera);
    out.distortion = state.cameras[index][kDistortion];
    out.corner_pixels = corner_displacement(out.camera, out.distortion);
    out.corner_brightness = 1 + double{state.cameras[index][kVignetting]};
    out.time_shift = out.camera.time_shift;
    out.time_offset = out.camera.time_offset + capture.time_base.seconds(out.time_shift);
  }
  return refined;
}

}  // namespace stgs::encoder
