// SPDX-License-Identifier: Apache-2.0
#include "encoder/live_settings.h"

#include <algorithm>
#include <cmath>

#include "encoder/live_parameters.h"
#include "stgs/encoder/prepare.h"
#include "stgs/format/camera.h"

namespace stgs::sdk {
namespace {

constexpr std::uint32_t kMaxCameras = 10'000;
constexpr std::size_t kCoefficients = 8, kFisheyeCoefficients = 4;

Outcome invalid_image(std::string message) {
  return {STGS_ERROR_ARGUMENT, "image: " + std::move(message)};
}

Outcome check_rig(const stgs_live_settings& s) {
  const bool has_cameras = s.cameras != nullptr;
  if (has_cameras == !text_of(s.rig).empty()) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("settings: {} of cameras and rig are set; set one of them",
                        has_cameras ? "both" : "neither")};
  }
  if (!has_cameras && s.camera_count > 0) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("settings: cameras is NULL, but camera_count is {}", s.camera_count)};
  }
  if (!has_cameras) return {};
  STGS_SDK_TRY(check_range("camera_count", s.camera_count, 2, kMaxCameras));
  if (s.fps > 0) return {};
  return {STGS_ERROR_ARGUMENT, "settings: fps is 0; state it, because cameras have none"};
}

#ifdef STGS_HAS_PREPARE

Outcome check_sizes(const stgs_live_camera& camera, std::size_t index) {
  constexpr std::uint32_t kMax = kMaxImageSide;
  const bool is_pair = (camera.width == 0) == (camera.height == 0);
  if (is_pair && camera.width <= kMax && camera.height <= kMax) return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("settings: cameras[{}]: the size is {} x {} (expected 1 to {} pixels, or 0 "
                      "for that of the images)",
                      index, camera.width, camera.height, kMax)};
}

Outcome to_rig(const stgs_live_camera& from, std::size_t index, encoder::RigCamera& to) {
  if (from.name == nullptr)
    return {STGS_ERROR_ARGUMENT, fmt::format("settings: cameras[{}]: name is NULL", index)};
  STGS_SDK_TRY(check_sizes(from, index));
  STGS_SDK_TRY(check_range("lens", from.lens, STGS_LENS_OPENCV, STGS_LENS_FISHEYE));
  to.name = from.name;
  to.width = static_cast<int>(from.width);
  to.height = static_cast<int>(from.height);
  to.fx = from.fx;
  to.fy = from.fy;
  to.cx = from.cx;
  to.cy = from.cy;
  to.fisheye = from.lens == STGS_LENS_FISHEYE;
  const std::size_t used = to.fisheye ? kFisheyeCoefficients : kCoefficients;
  to.distortion.assign(from.distortion, from.distortion + used);
  if (std::any_of(from.distortion + used, from.distortion + kCoefficients,
                  [](double k) { return k != 0; })) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("settings: cameras[{}]: a fisheye lens has {} coefficients of distortion, "
                        "but others are not 0",
                        index, kFisheyeCoefficients)};
  }
  for (std::size_t row = 0; row < 3; ++row) {
    std::copy_n(from.rotation + 3 * row, 3, to.world_to_camera.begin() + 4 * row);
    to.world_to_camera[4 * row + 3] = from.translation[row];
  }
  return {};
}

Outcome to_rig(const stgs_live_settings& s, std::vector<encoder::RigCamera>& out) {
  std::vector<stgs_live_camera> known(s.camera_count, default_live_camera());
  STGS_SDK_TRY(copy_in_array(s.cameras, std::span(known), "settings: cameras"));
  out.resize(known.size());
  for (std::size_t i = 0; i < known.size(); ++i) STGS_SDK_TRY(to_rig(known[i], i, out[i]));
  return {};
}

#endif

}  // namespace

stgs_live_camera default_live_camera() {
  stgs_live_camera camera{};
  camera.struct_size = sizeof(camera);
  camera.rotation[0] = camera.rotation[4] = camera.rotation[8] = 1;
  camera.lens = STGS_LENS_OPENCV;
  return camera;
}

stgs_live_settings default_live_settings() {
  const encoder::LiveSettings defaults;
  stgs_live_settings settings{};
  settings.struct_size = sizeof(settings);
  settings.scale = encoder::PrepareSettings{}.scale;
  settings.latency = defaults.latency;
  settings.start_seconds = defaults.start_seconds;
  settings.preset = STGS_PRESET_FAST;
  settings.seed = defaults.stream.train.seed;
  return settings;
}

stgs_live_image default_live_image() {
  stgs_live_image image{};
  image.struct_size = sizeof(image);
  image.format = STGS_PIXELS_RGB8;
  image.memory = STGS_MEMORY_HOST;
  return image;
}

Outcome check(const stgs_live_settings& s) {
  STGS_SDK_TRY(check_ranges<LiveParameters>(s));
  STGS_SDK_TRY(check_rig(s));
  STGS_SDK_TRY(check_flag("trust_calibration", s.trust_calibration));
  STGS_SDK_TRY(check_preset(s.preset));
  STGS_SDK_TRY(check_backend(s.backend));
  STGS_SDK_TRY(check_range("threads", s.threads, 0, kMaxThreads));
  STGS_SDK_TRY(check_text("title", s.title));
  return check_overrides(s.parameters, s.parameter_count);
}

std::size_t pixel_bytes(stgs_pixel_format format) {
  return format == STGS_PIXELS_RGBA8 || format == STGS_PIXELS_BGRA8 ? 4 : 3;
}

Outcome check(stgs_live_image& image) {
  if (image.data == nullptr) return invalid_image("data is NULL");
  constexpr std::uint32_t kMax = kMaxImageSide;
  if (image.width < 1 || image.width > kMax || image.height < 1 || image.height > kMax) {
    return invalid_image(fmt::format("the size is {} x {} (expected 1 to {} pixels)", image.width,
                                     image.height, kMax));
  }
  if (image.format < STGS_PIXELS_RGB8 || image.format > STGS_PIXELS_BGRA8)
    return invalid_image(fmt::format("format is {} (expected 0 to 3)", image.format));
  if (image.memory < STGS_MEMORY_HOST || image.memory > STGS_MEMORY_CUDA)
    return invalid_image(fmt::format("memory is {} (expected 0 or 1)", image.memory));
  const std::size_t row = pixel_bytes(image.format) * image.width;
  if (image.stride == 0) image.stride = row;
  if (image.stride >= row) return {};
  return invalid_image(fmt::format("stride is {} (expected 0, or at least {} for {} pixels of {})",
                                   image.stride, row, image.width, pixel_bytes(image.format)));
}

#ifdef STGS_HAS_PREPARE

Outcome open_rig(const stgs_live_settings& s, const encoder::LogSink& log,
                 std::unique_ptr<encoder::LivePreparer>& out) {
  encoder::PrepareSettings settings;
  settings.scale = s.scale;
  settings.seed = s.seed;
  settings.backend = backend_name(s.backend);
  settings.trust_calibration = s.trust_calibration != 0;
  if (s.cameras == nullptr) {
    STGS_ASSIGN(out, encoder::LivePreparer::open(s.rig, settings, s.fps, log));
    return {};
  }
  std::vector<encoder::RigCamera> cameras;
  STGS_SDK_TRY(to_rig(s, cameras));
  STGS_ASSIGN(out, encoder::LivePreparer::open(cameras, settings, s.fps));
  return {};
}

#else

Outcome open_rig(const stgs_live_settings&, const encoder::LogSink&,
                 std::unique_ptr<encoder::LivePreparer>&) {
  return not_built(
      "this build cannot encode live, because it lacks OpenCV or FFmpeg; use another build");
}

#endif

encoder::LiveSettings live_encoding_of(const stgs_live_settings& s, const std::string& recording) {
  encoder::LiveSettings settings;
  encoder::TrainSettings& train = settings.stream.train;
  train.preset = preset_name(s.preset);
  train.backend = backend_name(s.backend);
  train.iterations = static_cast<int>(s.iterations);
  train.max_primitives = static_cast<int>(s.max_primitives);
  train.seed = s.seed;
  train.overrides = overrides_of(s.parameters, s.parameter_count);
  settings.stream.title = text_of(s.title);
  settings.stream.recording = recording;
  settings.latency = s.latency;
  settings.target_kbps = s.target_kbps;
  settings.start_seconds = s.start_seconds;
  settings.queue_bytes = s.queue_bytes;
  return settings;
}

stgs_live_window to_c(const encoder::LiveWindow& window) {
  stgs_live_window out{};
  out.struct_size = sizeof(out);
  out.first_frame = static_cast<std::uint32_t>(window.first_frame);
  out.frames = static_cast<std::uint32_t>(window.frames);
  out.frames_waiting = static_cast<std::uint32_t>(window.waiting);
  out.iterations = static_cast<std::uint32_t>(window.iterations);
  out.missing = window.missing;
  out.primitives = window.primitives;
  out.bytes = window.bytes;
  out.loss = window.loss;
  out.prepare_seconds = window.prepare_seconds;
  out.train_seconds = window.train_seconds;
  out.latency = window.latency;
  out.written = window.written ? 1 : 0;
  out.psnr = window.psnr;
  out.scale = window.scale;
  return out;
}

stgs_live_report to_c(const encoder::LiveReport& report, bool ended) {
  stgs_live_report out{};
  out.cameras = static_cast<std::uint32_t>(report.cameras);
  out.frames = static_cast<std::uint32_t>(report.frames);
  out.windows = static_cast<std::uint32_t>(report.windows);
  out.lost_frames = static_cast<std::uint32_t>(report.lost_frames);
  out.images = report.received;
  out.dropped = report.dropped;
  out.dropped_late = report.late;
  out.dropped_repeated = report.repeated;
  out.dropped_ahead = report.ahead;
  out.dropped_overflow = report.overflow;
  out.missing = report.missing;
  out.primitives = report.primitives;
  out.static_primitives = report.persistent;
  out.bytes = report.bytes;
  out.latency_median = report.latency_median;
  out.latency_p95 = report.latency_p95;
  out.latency_max = report.latency_max;
  out.ended = ended ? 1 : 0;
  out.psnr = report.psnr;
  out.scale = report.scale;
  return out;
}

}  // namespace stgs::sdk
