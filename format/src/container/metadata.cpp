// SPDX-License-Identifier: Apache-2.0
// META, WNDW and ERRB: the metadata of a scene (spec 4).
#include <algorithm>
#include <cmath>

#include "container/container.h"
#include "core/bytes.h"
#include "stgs/format/camera.h"
#include "stgs/format/math/project.h"
#include "stgs/format/text.h"

namespace stgs {
namespace {

using N = IssueNumber;

constexpr std::uint64_t kWindowBytes = 24;
// Conventions of kernel and SH from this number on may be treated as 0 (spec 4.2).
constexpr std::uint8_t kFirstShownAsZero = 128;

bool all_finite(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

// Returns whether a reader knows the code points of the colour encoding (spec 4.4).
bool is_known_colour(const SceneMetadata& scene) {
  const auto is_one_of = [](std::uint8_t v, std::initializer_list<int> all) {
    return std::find(all.begin(), all.end(), v) != all.end();
  };
  return is_one_of(scene.primaries, {1, 9, 12}) && is_one_of(scene.transfer, {1, 8, 13});
}

bool is_finite(const StartCamera& camera) {
  const float intrinsics[4] = {camera.fx, camera.fy, camera.cx, camera.cy};
  return all_finite(camera.rotation) && all_finite(camera.translation) && all_finite(intrinsics);
}

void check_start_camera(const StartCamera& camera, std::uint64_t offset, Findings& findings) {
  const auto side = [](std::uint32_t v) { return v >= 1 && v <= kMaxImageSide; };
  if (!side(camera.width) || !side(camera.height)) {
    findings.error(N::kMetadataValue, offset,
                   "metadata: start camera has an invalid size (expected sides of 1 to {} pixels, "
                   "got {}x{})",
                   kMaxImageSide, camera.width, camera.height);
  }
  if (!is_finite(camera) || camera.fx <= 0.0f || camera.fy <= 0.0f) {
    findings.error(N::kMetadataValue, offset,
                   "metadata: start camera has values that are not finite, or a focal length <= 0");
  }
  if (!is_rotation(camera.rotation)) {
    findings.error(N::kMetadataValue, offset,
                   "metadata: start camera has an invalid rotation matrix");
  }
}

}  // namespace

std::vector<std::uint8_t> write_metadata(const FileMetadata& metadata) {  // spec 4.2
  const SceneMetadata& scene = metadata.scene;
  ByteWriter out;
  out.u32(scene.time_base.numerator);
  out.u32(scene.time_base.denominator);
  out.u32(scene.frames);
  out.u8(scene.kernel);
  out.u8(0);  // axes: OpenCV
  out.u8(scene.sh_convention);
  out.u8(static_cast<std::uint8_t>(metadata.sh_degree));
  out.u16(static_cast<std::uint16_t>(metadata.profile));
  out.u8(scene.primaries);
  out.u8(scene.transfer);
  for (float v : scene.background) out.f32(v);
  for (float v : scene.bounds_min) out.f32(v);
  for (float v : scene.bounds_max) out.f32(v);
  out.f32(scene.near_plane);
  const StartCamera camera = scene.start_camera.value_or(StartCamera{});
  out.u32(camera.width);
  out.u32(camera.height);
  for (float v : camera.rotation) out.f32(v);
  for (float v : camera.translation) out.f32(v);
  for (float v : {camera.fx, camera.fy, camera.cx, camera.cy}) out.f32(v);
  out.string(scene.generator);
  out.string(scene.title);
  out.f32(scene.metres_per_unit);
  for (float v : scene.up) out.f32(v);
  for (float v : scene.floor) out.f32(v);
  out.string(scene.audio);
  out.f64(scene.audio_begin);
  return out.take();
}

std::vector<std::uint8_t> write_window(const CaptureWindow& window) {  // spec 4.5
  ByteWriter out;
  out.u32(window.first_frame);
  out.u32(window.capture_frames);
  out.u64(window.capture);
  out.u64(window.training);
  return out.take();
}

void check_metadata_values(const FileMetadata& metadata, std::uint64_t offset, Findings& findings) {
  const SceneMetadata& scene = metadata.scene;
  const bool finite = all_finite(scene.background) && all_finite(scene.bounds_min) &&
                      all_finite(scene.bounds_max) && std::isfinite(scene.near_plane);
  if (!finite || scene.near_plane < 0.0f) {
    findings.error(N::kMetadataValue, offset,
                   "metadata: background, bounds or near plane is not finite, or the near plane is "
                   "negative");
  }
  const double length = std::hypot(double{scene.up[0]}, double{scene.up[1]}, double{scene.up[2]});
  if (!all_finite(scene.up) || !all_finite(scene.floor) || !std::isfinite(scene.metres_per_unit) ||
      scene.metres_per_unit < 0.0f || (length != 0.0 && std::abs(length - 1.0) > 1e-3)) {
    findings.error(N::kMetadataValue, offset,
                   "metadata: invalid unit ({} metres), up vector (length {}) or floor",
                   scene.metres_per_unit, length);
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (scene.bounds_min[axis] > scene.bounds_max[axis]) {
      findings.error(N::kMetadataValue, offset, "metadata: bounds of axis {} are inverted", axis);
    }
  }
  if (scene.start_camera) check_start_camera(*scene.start_camera, offset, findings);
  if (!(std::abs(scene.audio_begin) <= kMaxChunk)) {
    findings.error(N::kMetadataValue, offset, "metadata: invalid beginning of the audio, tick {}",
                   scene.audio_begin);
  }
  if (!is_utf8(scene.generator) || !is_utf8(scene.title) || !is_utf8(scene.audio)) {
    findings.error(N::kMetadataText, offset,
                   "metadata: generator, title or audio location is not UTF-8");
  }
}

namespace {

// The fields of META as they are stored (spec 4.2), besides those of the scene.
struct MetadataFields {
  std::uint8_t axes = 0;
  StartCamera camera;  // of 0x0 pixels: none
};

MetadataFields read_fields(ByteReader& in, FileMetadata& metadata) {
  MetadataFields out;
  SceneMetadata& scene = metadata.scene;
  scene.time_base.numerator = in.u32();
  scene.time_base.denominator = in.u32();
  scene.frames = in.u32();
  scene.kernel = in.u8();
  out.axes = in.u8();
  scene.sh_convention = in.u8();
  metadata.sh_degree = in.u8();
  metadata.profile_number = in.u16();
  scene.primaries = in.u8();
  scene.transfer = in.u8();
  for (float& v : scene.background) v = in.f32();
  for (float& v : scene.bounds_min) v = in.f32();
  for (float& v : scene.bounds_max) v = in.f32();
  scene.near_plane = in.f32();
  StartCamera& camera = out.camera;
  camera.width = in.u32();
  camera.height = in.u32();
  for (float& v : camera.rotation) v = in.f32();
  for (float& v : camera.translation) v = in.f32();
  for (float* v : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *v = in.f32();
  scene.generator = in.string();
  scene.title = in.string();
  scene.metres_per_unit = in.f32();
  for (float& v : scene.up) v = in.f32();
  for (float& v : scene.floor) v = in.f32();
  scene.audio = in.string();
  scene.audio_begin = in.f64();
  return out;
}

// Checks the conventions of kernel, axes, SH and colours (spec 4.3, 4.4).
bool check_conventions(const SceneMetadata& scene, std::uint8_t axes, std::uint64_t offset,
                       Findings& findings) {
  const auto unknown = [](std::uint8_t v, int known) { return v > known && v < kFirstShownAsZero; };
  if (axes != 0 || unknown(scene.kernel, math::kBandLimited) || unknown(scene.sh_convention, 0)) {
    findings.unsupported(
        N::kMetadataConvention, offset + 12,
        "metadata: unknown convention (kernel {}, axes {}, SH {}); a later version is needed",
        scene.kernel, axes, scene.sh_convention);
    return false;
  }
  if (scene.kernel >= kFirstShownAsZero || scene.sh_convention >= kFirstShownAsZero) {
    findings.warning(N::kMetadataConvention, offset + 12,
                     "metadata: convention of a later version is treated as 0 (kernel {}, SH {})",
                     scene.kernel, scene.sh_convention);
  }
  if (!is_known_colour(scene)) {
    findings.warning(N::kColour, offset + 18,
                     "metadata: unknown colour encoding is displayed as sRGB (primaries {}, "
                     "transfer function {})",
                     scene.primaries, scene.transfer);
  }
  return true;
}

}  // namespace

bool parse_metadata(std::span<const std::uint8_t> payload, std::uint64_t offset,
                    FileMetadata& metadata, Findings& findings) {  // spec 4.2
  ByteReader in(payload);
  SceneMetadata& scene = metadata.scene;
  const auto [axes, camera] = read_fields(in, metadata);
  if (!in.ok()) {
    findings.error(N::kMetadataLayout, offset, "metadata: too short ({} bytes)", payload.size());
    return false;
  }
  if (!check_conventions(scene, axes, offset, findings)) return false;
  metadata.profile = metadata.profile_number <= static_cast<int>(Profile::kNearLossless)
                         ? static_cast<Profile>(metadata.profile_number)
                         : Profile::kUnknown;
  if (camera.width != 0 || camera.height != 0) {
    scene.start_camera = camera;
  } else if (!is_finite(camera)) {
    findings.error(N::kMetadataValue, offset + 68,
                   "metadata: values of the start camera that are not finite");
    return false;
  }
  if (scene.time_base.numerator == 0 || scene.time_base.denominator == 0 || scene.frames == 0) {
    findings.error(N::kTimeBase, offset, "metadata: invalid duration ({} frames of {}/{} s)",
                   scene.frames, scene.time_base.numerator, scene.time_base.denominator);
    return false;
  }
  if (metadata.sh_degree > 3) {
    findings.unsupported(N::kShDegree, offset + 15,
                         "metadata: unsupported SH degree (expected 0 to 3, got {})",
                         metadata.sh_degree);
    return false;
  }
  check_metadata_values(metadata, offset, findings);
  return true;
}

bool parse_window(std::span<const std::uint8_t> payload, std::uint64_t offset,
                  SceneMetadata& metadata, Findings& findings) {  // spec 4.5
  if (payload.size() < kWindowBytes) {
    findings.error(N::kWindow, offset, "window: too short ({} bytes)", payload.size());
    return false;
  }
  ByteReader in(payload);
  CaptureWindow window;
  window.first_frame = in.u32();
  window.capture_frames = in.u32();
  window.capture = in.u64();
  window.training = in.u64();
  metadata.window = window;
  return true;
}

std::vector<std::uint8_t> write_error_bounds(std::span<const ErrorBound> bounds) {  // spec 4.7
  ByteWriter out;
  out.u16(static_cast<std::uint16_t>(bounds.size()));
  for (const ErrorBound& bound : bounds) {
    out.u16(static_cast<std::uint16_t>(bound.attribute));
    out.f32(bound.greatest);
    out.f32(bound.rms);
  }
  return out.take();
}

bool parse_error_bounds(std::span<const std::uint8_t> payload, std::uint64_t offset, FileHead& head,
                        Findings& findings) {
  ByteReader in(payload);
  const auto is_error = [](float v) { return std::isfinite(v) && v >= 0.0f; };
  std::vector<ErrorBound> bounds;
  bool good = true;
  for (std::uint32_t left = in.u16(); left > 0 && in.ok(); --left) {
    const auto attribute = static_cast<Attribute>(in.u16());
    const float greatest = in.f32(), rms = in.f32();
    good = good && is_error(greatest) && is_error(rms);
    bounds.push_back({attribute, greatest, rms});
  }
  if (!in.ok() || !good) {
    findings.error(N::kErrorBounds, offset, "error bounds: truncated, or an invalid value");
    return false;
  }
  head.error_bounds = std::move(bounds);
  return true;
}

void check_window(SceneMetadata& metadata, Findings& findings) {
  if (!metadata.window) return;
  const CaptureWindow window = *metadata.window;
  if (std::uint64_t{window.first_frame} + metadata.frames <= window.capture_frames) return;
  findings.damage(N::kWindow, kHeaderBytes,
                  "window: frames {} to {} exceed the capture of {} frames", window.first_frame,
                  std::uint64_t{window.first_frame} + metadata.frames - 1, window.capture_frames);
  metadata.window.reset();
}

math::PinholeCamera pinhole_of(const StartCamera& camera, float near_plane) {
  const float *r = camera.rotation, *t = camera.translation;
  math::PinholeCamera out;
  out.rotation = {r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]};
  out.translation = {t[0], t[1], t[2]};
  out.fx = camera.fx;
  out.fy = camera.fy;
  out.cx = camera.cx;
  out.cy = camera.cy;
  out.width = static_cast<float>(camera.width);
  out.height = static_cast<float>(camera.height);
  out.near_plane = near_plane;
  return out;
}

}  // namespace stgs
