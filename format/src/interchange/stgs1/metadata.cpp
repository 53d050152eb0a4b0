// SPDX-License-Identifier: Apache-2.0
// Clauses 3.5 and 4: META, WNDW and PRIV.
#include <algorithm>
#include <cmath>

#include "interchange/stgs1/file.h"
#include "stgs/format/camera.h"
#include "stgs/format/text.h"

namespace stgs::stgs1 {
namespace {

constexpr std::uint8_t kFirstShownAsZero = 128;  // 4.2
constexpr float kUpTolerance = 1e-3f;            // of the length of up, 4.3

bool are_finite(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

template <std::size_t N>
void read_floats(ByteReader& in, float (&out)[N]) {
  for (float& v : out) v = in.f32();
}

Status check_conventions(const SceneMetadata& scene, int axes, std::uint8_t colour,
                         File& file) {  // 4.2
  const std::uint8_t all[] = {scene.kernel, colour, scene.sh_convention};
  const bool is_unknown = std::any_of(std::begin(all), std::end(all), [](std::uint8_t v) {
    return v != 0 && v < kFirstShownAsZero;
  });
  if (axes != 0 || is_unknown) {
    return unsupported("unknown conventions (kernel {}, axes {}, colour {}, SH {})", scene.kernel,
                       axes, colour, scene.sh_convention);
  }
  if (scene.kernel != 0 || colour != 0 || scene.sh_convention != 0) {
    file.notes.push_back(
        fmt::format("conventions of a later version are treated as 0 (kernel {}, colour {}, SH {})",
                    scene.kernel, colour, scene.sh_convention));
  }
  return {};
}

Status check_camera(const StartCamera& camera) {  // 4.3
  const auto is_side = [](std::uint32_t v) { return v >= 1 && v <= kMaxImageSide; };
  const float lens[] = {camera.fx, camera.fy, camera.cx, camera.cy};
  if (is_side(camera.width) && is_side(camera.height) && are_finite(camera.translation) &&
      are_finite(lens) && camera.fx > 0 && camera.fy > 0 && is_rotation(camera.rotation)) {
    return {};
  }
  return invalid_file("the start camera has an invalid size, focal length or rotation");
}

Status check_values(const SceneMetadata& scene) {  // 4.3
  const double length = std::hypot(double{scene.up[0]}, double{scene.up[1]}, double{scene.up[2]});
  if (!are_finite(scene.background) || !(scene.near_plane >= 0) ||
      !std::isfinite(scene.near_plane) || !are_finite(scene.up) || !are_finite(scene.floor) ||
      !std::isfinite(scene.metres_per_unit) || scene.metres_per_unit < 0 ||
      (length != 0 && std::abs(length - 1) > double{kUpTolerance}) ||
      !(std::abs(scene.audio_begin) <= kMaxTime)) {
    return invalid_file("META has a number that is not finite or out of range");
  }
  if (!is_utf8(scene.generator) || !is_utf8(scene.title) || !is_utf8(scene.audio)) {
    return invalid_file("generator, title or audio location is not UTF-8");
  }
  if (scene.start_camera) STGS_TRY(check_camera(*scene.start_camera));
  return check_bounds(scene);
}

}  // namespace

Status check_bounds(const SceneMetadata& scene) {
  bool is_valid = are_finite(scene.bounds_min) && are_finite(scene.bounds_max);
  for (int i = 0; i < 3; ++i) is_valid = is_valid && scene.bounds_min[i] <= scene.bounds_max[i];
  return is_valid ? Status() : invalid_file("the bounds are inverted or not finite");
}

Status read_metadata(View payload, File& file) {  // 4.2
  ByteReader in(payload);
  SceneMetadata& scene = file.metadata;
  scene.time_base.numerator = in.u32();
  scene.time_base.denominator = in.u32();
  scene.frames = in.u32();
  scene.kernel = in.u8();
  const int axes = in.u8();
  const std::uint8_t colour = in.u8();
  scene.sh_convention = in.u8();
  file.profile = in.u16();
  file.degree = in.u16();
  read_floats(in, scene.background);
  read_floats(in, scene.bounds_min);
  read_floats(in, scene.bounds_max);
  scene.near_plane = in.f32();
  StartCamera camera;
  camera.width = in.u32();
  camera.height = in.u32();
  read_floats(in, camera.rotation);
  read_floats(in, camera.translation);
  for (float* v : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *v = in.f32();
  if (camera.width != 0 || camera.height != 0) scene.start_camera = camera;
  scene.generator = in.string();
  scene.title = in.string();
  scene.metres_per_unit = in.f32();
  read_floats(in, scene.up);
  read_floats(in, scene.floor);
  scene.audio = in.string();
  scene.audio_begin = in.f64();
  if (!in.ok()) return invalid_file("META is too short ({} bytes)", payload.size());
  STGS_TRY(check_conventions(scene, axes, colour, file));
  if (scene.time_base.numerator == 0 || scene.time_base.denominator == 0 || scene.frames == 0) {
    return invalid_file("the time base or the duration is 0");
  }
  if (file.degree > 3) {
    return unsupported("unsupported SH degree (expected 0 to 3, got {})", file.degree);
  }
  return check_values(scene);
}

Status read_window(View payload, SceneMetadata& metadata) {  // 4.5
  ByteReader in(payload);
  CaptureWindow window;
  window.first_frame = in.u32();
  window.capture_frames = in.u32();
  window.capture = in.u64();
  window.training = in.u64();
  if (!in.ok()) return invalid_file("a training window of {} bytes is too short", payload.size());
  metadata.window = window;
  return {};
}

Status check_private_names(View payload) {  // 3.5
  ByteReader in(payload);
  const int count = in.u16();
  for (int i = 0; i < count && in.ok(); ++i) {
    in.u32();  // kind and number
    const std::string name = in.string();
    if (name.empty() || !is_utf8(name)) return invalid_file("a private name is empty or not UTF-8");
  }
  return in.ok() ? Status() : invalid_file("the private names are truncated");
}

}  // namespace stgs::stgs1
