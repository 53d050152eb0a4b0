// SPDX-License-Identifier: Apache-2.0
// Places the camera of a view: look-at and orbit.
#include <algorithm>
#include <array>
#include <cmath>
#include <new>
#include <numbers>

#include "structs.h"
#include "view.h"

namespace stgs::sdk {
namespace {

using Vector = std::array<double, 3>;
using Matrix = std::array<Vector, 3>;  // rows

constexpr double kMinSine = 1e-6;  // of the angle between two directions
constexpr double kPositionResolution =
    1e-6;  // of positions, relative to their distance from the origin
constexpr double kMaxElevation = 89 * std::numbers::pi / 180;

double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Vector scaled(const Vector& a, double factor) {
  return {a[0] * factor, a[1] * factor, a[2] * factor};
}
Vector operator+(const Vector& a, const Vector& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
Vector operator-(const Vector& a, const Vector& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double length(const Vector& a) {
  return std::hypot(a[0], a[1], a[2]);
}
// The vector must not be 0.
Vector normalised(const Vector& a) {
  return scaled(a, 1 / length(a));
}
Vector vector_of(const float* a) {
  return {a[0], a[1], a[2]};
}
Vector multiply(const Matrix& m, const Vector& v) {
  return {dot(m[0], v), dot(m[1], v), dot(m[2], v)};
}

bool is_finite(const float* a) {
  return std::isfinite(a[0]) && std::isfinite(a[1]) && std::isfinite(a[2]);
}

Matrix rotation_of(const stgs_view& view) {
  return {vector_of(view.rotation), vector_of(view.rotation + 3), vector_of(view.rotation + 6)};
}

// Position of the camera in the world.
Vector position_of(const Matrix& rotation, const Vector& translation) {
  Vector out{};
  for (std::size_t row = 0; row < 3; ++row) out = out - scaled(rotation[row], translation[row]);
  return out;
}

// Unit vector of the caller's `up` or, if that is NULL or 0, of the view's own up direction.
Vector up_of(const float* up, const stgs_view& view) {
  if (up != nullptr && length(vector_of(up)) > 0) return normalised(vector_of(up));
  return scaled(normalised(vector_of(view.rotation + 3)), -1);
}

// Sets the rotation, whose first two rows are made orthonormal, and the translation. Returns false
// if a value is not finite as a float.
bool set_pose(Matrix rotation, const Vector& translation, stgs_view& view) {
  rotation[2] = normalised(rotation[2]);
  rotation[0] = normalised(cross(rotation[1], rotation[2]));
  rotation[1] = cross(rotation[2], rotation[0]);
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t i = 0; i < 3; ++i) {
      view.rotation[3 * row + i] = static_cast<float>(rotation[row][i]);
    }
    view.translation[row] = static_cast<float>(translation[row]);
  }
  return is_finite(view.translation);
}

// Rotates `v` by `angle` radians around the unit vector `axis`, by the right-hand rule.
Vector rotated(const Vector& v, const Vector& axis, double angle) {
  const double c = std::cos(angle), s = std::sin(angle), along = (1 - c) * dot(axis, v);
  const Vector side = cross(axis, v);
  return {c * v[0] + s * side[0] + along * axis[0], c * v[1] + s * side[1] + along * axis[1],
          c * v[2] + s * side[2] + along * axis[2]};
}

// Reduces `elevation` so that the camera, at `offset` from the centre, stays kMaxElevation from the
// horizontal plane. A camera beyond that may only come back.
double limited_elevation(const Vector& offset, const Vector& up, double elevation) {
  const double sine = std::clamp(dot(offset, up) / length(offset), -1.0, 1.0);
  const double current = std::asin(sine);
  const double low = std::min(-kMaxElevation, current), high = std::max(kMaxElevation, current);
  return std::clamp(current + elevation, low, high) - current;
}

// Rotates the camera, rigidly, around an axis through `centre`.
void rotate_camera(const Vector& centre, const Vector& axis, double angle, Matrix& rotation,
                   Vector& translation) {
  // The centre keeps its camera coordinates.
  const Vector at_centre = multiply(rotation, centre) + translation;
  for (Vector& row : rotation) row = rotated(row, axis, angle);
  translation = at_centre - multiply(rotation, centre);
}

// A view that is invalid needs memory for its message, which is not used here.
bool is_valid(const stgs_view& view) try {
  return check_view(view).result == STGS_OK;
} catch (const std::bad_alloc&) {
  return false;
}

stgs_result look_at(const float* eye, const float* target, const float* up, stgs_view& view) {
  const Vector position = vector_of(eye), direction = vector_of(target) - position;
  if (!(length(direction) > 0)) return STGS_ERROR_ARGUMENT;
  Matrix rotation;
  rotation[2] = normalised(direction);
  const Vector side = cross(rotation[2], up_of(up, view));
  if (!(length(side) > kMinSine)) return STGS_ERROR_ARGUMENT;
  rotation[0] = normalised(side);
  rotation[1] = cross(rotation[2], rotation[0]);
  const Vector translation = scaled(multiply(rotation, position), -1);
  return set_pose(rotation, translation, view) ? STGS_OK : STGS_ERROR_ARGUMENT;
}

stgs_result orbit(const float* centre, const float* up, double azimuth, double elevation,
                  stgs_view& view) {
  const Vector around = vector_of(centre), axis = up_of(up, view);
  Matrix rotation = rotation_of(view);
  Vector translation = vector_of(view.translation);
  rotate_camera(around, axis, azimuth, rotation, translation);
  const Vector offset = position_of(rotation, translation) - around;
  // At the centre the offset is 0, apart from the rounding of the translation.
  if (!(length(offset) > kPositionResolution * length(around))) return STGS_ERROR_ARGUMENT;
  if (elevation != 0) {
    const Vector side = cross(offset, axis);
    const bool at_pole = length(side) < kMinSine * length(offset);
    const Vector horizontal = at_pole ? scaled(rotation[0], -1) : normalised(side);
    rotate_camera(around, horizontal, limited_elevation(offset, axis, elevation), rotation,
                  translation);
  }
  return set_pose(rotation, translation, view) ? STGS_OK : STGS_ERROR_ARGUMENT;
}

}  // namespace
}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_view_look_at(stgs_view* view, const float eye[3], const float target[3],
                              const float up[3]) {
  using namespace stgs::sdk;
  stgs_view out = default_view();
  if (const stgs_result bad = copy_in(view, out); bad != STGS_OK) return bad;
  if (eye == nullptr || target == nullptr || !is_finite(eye) || !is_finite(target) ||
      (up != nullptr && !is_finite(up)) || !is_valid(out)) {
    return STGS_ERROR_ARGUMENT;
  }
  const stgs_result result = look_at(eye, target, up, out);
  if (result == STGS_OK) copy_out(view, out);
  return result;
}

stgs_result stgs_view_orbit(stgs_view* view, const float centre[3], const float up[3],
                            double azimuth, double elevation) {
  using namespace stgs::sdk;
  stgs_view out = default_view();
  if (const stgs_result bad = copy_in(view, out); bad != STGS_OK) return bad;
  if (centre == nullptr || !is_finite(centre) || (up != nullptr && !is_finite(up)) ||
      !std::isfinite(azimuth) || !std::isfinite(elevation) || !is_valid(out)) {
    return STGS_ERROR_ARGUMENT;
  }
  const stgs_result result = orbit(centre, up, azimuth, elevation, out);
  if (result == STGS_OK) copy_out(view, out);
  return result;
}

}  // extern "C"
