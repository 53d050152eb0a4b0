// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/prepared_capture.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "json_error.h"
#include "json_read.h"
#include "single_precision.h"
#include "stgs/encoder/camera_json.h"
#include "stgs/encoder/capture_folder.h"
#include "stgs/encoder/frame_memory.h"
#include "stgs/encoder/image_file.h"
#include "stgs/encoder/protocol.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/output_file.h"

namespace stgs::encoder {
namespace {

constexpr int kCaptureVersion = 1;
constexpr int kMaxFirstFrame = 1'000'000'000;
constexpr std::uint32_t kMaxTimeBase = 0xffffffff;

Result<PreparedCapture> capture_from_json(const nlohmann::json& json, const std::string& folder,
                                          const std::string& path) {
  PreparedCapture capture;
  capture.folder = folder;
  STGS_ASSIGN(capture.first_frame, exact<int>(json, "first_frame", 0, kMaxFirstFrame, path));
  STGS_ASSIGN(capture.frames, exact<int>(json, "frames", 1, kCaptureLimits.frames, path));
  std::uint32_t* const parts[] = {&capture.time_base.numerator, &capture.time_base.denominator};
  for (std::size_t i = 0; i < 2; ++i) {
    STGS_ASSIGN(*parts[i], exact_value<std::uint32_t>(json.at("time_base").at(i), 0, kMaxTimeBase,
                                                      "time_base", path));
  }
  capture.metric = json.at("metric").get<bool>();
  capture.frame_extension = json.at("frame_extension").get<std::string>();
  capture.source = json.at("source").get<std::string>();
  if (json.contains("protocol")) capture.protocol = json.at("protocol").get<std::string>();
  capture.near_plane = json.at("near_plane").get<float>();
  capture.extent = json.at("extent").get<float>();
  capture.scene_radius = json.at("scene_radius").get<double>();
  for (int i = 0; i < 3; ++i) capture.scene_centre[i] = json.at("scene_centre").at(i).get<double>();
  STGS_TRY(check_camera_limit(json.at("cameras").size(), path));
  for (const nlohmann::json& entry : json.at("cameras")) {
    STGS_ASSIGN(capture.cameras.emplace_back(), camera_from_json(entry, path));
  }
  return capture;
}

Status check_capture_camera(const Camera& camera, const std::string& path) {
  const bool unsafe = camera.name.empty() || camera.name.front() == '.' ||
                      camera.name.find("..") != std::string::npos ||
                      camera.name.find('/') != std::string::npos || !is_printable(camera.name);
  if (unsafe) {
    return invalid_file(
        "{}: camera name {} cannot be a folder name (no '/', '..', '.' at the start or control "
        "characters)",
        path, short_json(nlohmann::json(camera.name)));
  }
  return check_camera(camera, path);
}

Status check(const PreparedCapture& capture, const std::string& path) {
  if (capture.cameras.empty()) return invalid_file("{}: contains no cameras", path);
  STGS_TRY(check_camera_limit(capture.cameras.size(), path));
  if (capture.frames < 1 || capture.frames > kCaptureLimits.frames) {
    return invalid_file("{}: \"frames\" is {} (expected 1 to {})", path, capture.frames,
                        kCaptureLimits.frames);
  }
  if (!capture.protocol.empty() && find_protocol(capture.protocol) == nullptr) {
    return invalid_file("{}: unknown protocol {}", path,
                        short_json(nlohmann::json(capture.protocol)));
  }
  if (capture.frame_extension != "png" && capture.frame_extension != "jpg") {
    return invalid_file("{}: frame_extension is '{}' (expected png or jpg)", path,
                        capture.frame_extension);
  }
  if (capture.time_base.numerator == 0 || capture.time_base.denominator == 0) {
    return invalid_file("{}: time_base is {}/{} (expected two positive numbers)", path,
                        capture.time_base.numerator, capture.time_base.denominator);
  }
  if (!positive_in_float(capture.near_plane) || !positive_in_float(capture.extent) ||
      !positive_in_float(capture.scene_radius) ||
      !std::all_of(capture.scene_centre, capture.scene_centre + 3, finite_in_float)) {
    return invalid_file(
        "{}: near_plane ({}), extent ({}) and scene_radius ({}) must be positive and finite, "
        "and scene_centre finite; prepare the capture again",
        path, capture.near_plane, capture.extent, capture.scene_radius);
  }
  std::set<std::string_view> names;
  for (const Camera& camera : capture.cameras) {
    STGS_TRY(check_capture_camera(camera, path));
    if (names.insert(camera.name).second) continue;
    return invalid_file("{}: two cameras have the name '{}'; prepare the capture again", path,
                        camera.name);
  }
  return {};
}

}  // namespace

math::PinholeCamera Camera::pinhole(float near_plane) const {
  math::PinholeCamera camera;
  const auto f = [](double v) { return static_cast<float>(v); };
  camera.rotation = {f(rotation[0]), f(rotation[1]), f(rotation[2]), f(rotation[3]), f(rotation[4]),
                     f(rotation[5]), f(rotation[6]), f(rotation[7]), f(rotation[8])};
  camera.translation = {f(translation[0]), f(translation[1]), f(translation[2])};
  camera.fx = f(fx);
  camera.fy = f(fy);
  camera.cx = f(cx);
  camera.cy = f(cy);
  camera.width = static_cast<float>(width);
  camera.height = static_cast<float>(height);
  camera.near_plane = near_plane;
  return camera;
}

std::vector<Camera> PreparedCapture::training_cameras() const {
  std::vector<Camera> training;
  std::copy_if(cameras.begin(), cameras.end(), std::back_inserter(training),
               [](const Camera& camera) { return !camera.test; });
  return training;
}

std::int64_t PreparedCapture::own_frame(const Camera& camera, int frame) const {
  constexpr double kTie = 1e-6;   // of two images that are equally near, the later one
  constexpr double kMost = 1e15;  // that a hostile capture.json cannot exceed
  const std::int64_t number = std::int64_t{first_frame} + frame;
  if (camera.time_offset == 0 && camera.fps == 0) return number;
  const double seconds = time_base.seconds(static_cast<double>(number)) - camera.time_offset;
  const double fps = camera.fps > 0 ? camera.fps : 1 / time_base.seconds(1);
  const double own = std::floor(seconds * fps + 0.5 + kTie);
  return static_cast<std::int64_t>(std::clamp(own, -kMost, kMost));
}

double PreparedCapture::time_of(const Camera& camera, int frame) const {
  if (camera.time_offset == 0 && camera.fps == 0) return frame + camera.time_shift;
  const double second = 1 / time_base.seconds(1);  // in ticks
  const auto own = static_cast<double>(own_frame(camera, frame));
  const double since = camera.fps > 0 ? own / camera.fps * second : own;
  return since + camera.time_offset * second - first_frame + camera.time_shift;
}

std::string PreparedCapture::frame_path(const Camera& camera, int frame) const {
  return fmt::format("{}/frames/{}/{:06}.{}", folder, camera.name, frame + frame_offset(),
                     frame_extension);
}

std::string PreparedCapture::mask_path(const Camera& camera, int frame) const {
  return fmt::format("{}/masks/{}/{:06}.png", folder, camera.name, frame + frame_offset());
}

namespace {

// Returns why there is no capture.json.
Status explain_missing(const std::string& folder, const std::string& path, const Status& status) {
  std::error_code none;
  const auto found = std::filesystem::status(folder, none);
  if (!std::filesystem::exists(found)) {
    return io_error("{}: no such file or folder; 'stgs prepare' writes prepared captures", folder);
  }
  if (!std::filesystem::is_directory(found)) {
    return invalid_file(
        "{}: not a prepared capture (expected a folder, got a file); make one with "
        "'stgs prepare'",
        folder);
  }
  if (std::filesystem::exists(path, none)) return status;
  return invalid_file("{}: not a prepared capture (no {}); make one with 'stgs prepare'", folder,
                      path);
}

}  // namespace

Result<PreparedCapture> read_prepared_capture(const std::string& folder, bool allow_outside) {
  const std::string path = folder + "/capture.json";
  const Result<std::shared_ptr<const CaptureFolder>> files =
      CaptureFolder::open(folder, allow_outside);
  if (!files.ok()) return explain_missing(folder, path, files.status());
  const Result<std::vector<std::uint8_t>> bytes =
      (*files)->read(path, kCaptureLimits.prepared_bytes);
  if (!bytes.ok()) return explain_missing(folder, path, bytes.status());
  const std::string_view text(reinterpret_cast<const char*>(bytes->data()), bytes->size());
  STGS_ASSIGN(const nlohmann::json json, parse_json_text(text, path));
  try {
    const nlohmann::json version = json.at("stgs_capture");
    if (!version.is_number() || version.get<double>() != kCaptureVersion) {
      return unsupported("{}: unknown version {} (expected {}); prepare the capture again", path,
                         short_json(version), kCaptureVersion);
    }
    STGS_ASSIGN(PreparedCapture capture, capture_from_json(json, folder, path));
    STGS_TRY(check(capture, path));
    capture.files = *files;
    return capture;
  } catch (const std::exception& error) {
    return invalid_file("{}: {}", path, json_error(error));
  }
}

Result<std::unique_ptr<ByteSource>> open_file_of(const PreparedCapture& capture,
                                                 const std::string& path) {
  return capture.files ? capture.files->open_source(path) : open_file(path);
}

Status check_frame_files(const PreparedCapture& capture, const std::vector<Camera>& cameras) {
  if (!capture.files || capture.memory_only) return {};
  const auto check_exists = [&](const Camera& camera, int frame) -> Status {
    const std::string path = capture.frame_path(camera, frame);
    if (capture.files->exists(path)) return {};
    return io_error(
        "{}: no such file: frame {} of camera '{}', of {} that capture.json states; copy the "
        "capture again, or run 'stgs prepare' again",
        path, frame, camera.name, capture.frames);
  };
  DistinctFiles folders;
  FrameFiles frames;
  for (const Camera& camera : cameras) {
    const std::string folder = fmt::format("{}/frames/{}", capture.folder, camera.name);
    const std::string where = fmt::format("{}: camera '{}'", capture.folder, camera.name);
    STGS_TRY(folders.add(*capture.files, folder, where));
    for (int frame = 0; frame < capture.frames; ++frame) {
      STGS_TRY(check_exists(camera, frame));
      STGS_TRY(frames.add(*capture.files, capture.frame_path(camera, frame)));
    }
  }
  return frames.check(capture.folder);
}

Status write_prepared_capture(const PreparedCapture& capture) {
  const std::string path = capture.folder + "/capture.json";
  STGS_TRY(check(capture, path));
  nlohmann::ordered_json json = {
      {"stgs_capture", kCaptureVersion},
      {"source", capture.source},
      {"first_frame", capture.first_frame},
      {"frames", capture.frames},
      {"time_base", {capture.time_base.numerator, capture.time_base.denominator}},
      {"metric", capture.metric},
      {"frame_extension", capture.frame_extension},
      {"near_plane", capture.near_plane},
      {"extent", capture.extent},
      {"scene_centre", std::vector<double>(capture.scene_centre, capture.scene_centre + 3)},
      {"scene_radius", capture.scene_radius},
      {"cameras", nlohmann::ordered_json::array()}};
  if (!capture.protocol.empty()) json["protocol"] = capture.protocol;
  for (const Camera& camera : capture.cameras) json["cameras"].push_back(camera_to_json(camera));
  std::string text;
  try {
    text = json.dump(1) + "\n";
  } catch (const nlohmann::json::exception& error) {
    return invalid_file("{}: a name is not valid UTF-8: {}", path, json_error(error));
  }
  return write_file_atomically(path,
                               {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

namespace {

// Returns the image of the folder's frame or mask in memory; null if it is not there.
FrameMemory::ImagePtr frame_in_memory(const PreparedCapture& capture, const Camera& camera,
                                      int frame) {
  return capture.memory ? capture.memory->frame(camera.name, frame + capture.frame_offset())
                        : nullptr;
}
FrameMemory::ImagePtr mask_in_memory(const PreparedCapture& capture, const Camera& camera,
                                     int frame) {
  return capture.memory ? capture.memory->mask(camera.name, frame + capture.frame_offset())
                        : nullptr;
}

Result<Image8> decode_frame(const PreparedCapture& capture, const Camera& camera, int frame) {
  if (const auto image = frame_in_memory(capture, camera, frame)) return *image;
  const std::string path = capture.frame_path(camera, frame);
  STGS_ASSIGN(const std::unique_ptr<ByteSource> file, open_file_of(capture, path));
  STGS_ASSIGN(Image8 image, read_image8(*file, 3));
  if (image.width != camera.width || image.height != camera.height) {
    return invalid_file("{}: camera '{}' frame {} has the wrong size (expected {}x{}, got {}x{})",
                        path, camera.name, frame, camera.width, camera.height, image.width,
                        image.height);
  }
  return image;
}

}  // namespace

bool has_frame(const PreparedCapture& capture, const Camera& camera, int frame) {
  return !capture.memory_only || frame_in_memory(capture, camera, frame) != nullptr;
}

bool has_mask(const PreparedCapture& capture, const Camera& camera, int frame) {
  if (mask_in_memory(capture, camera, frame)) return true;
  if (capture.memory_only) return false;
  const std::string path = capture.mask_path(camera, frame);
  return capture.files ? capture.files->exists(path) : std::filesystem::exists(path);
}

Status missing_mask(const PreparedCapture& capture, const Camera& camera, int frame) {
  return invalid_file(
      "{}: frame {} of camera '{}' has no mask, which the foreground needs; put masks into the "
      "folder masks of the capture and prepare it again",
      capture.mask_path(camera, frame), frame, camera.name);
}

Result<Image8> load_foreground(const PreparedCapture& capture, const Camera& camera, int frame,
                               const std::array<std::uint8_t, 3>& colour) {
  STGS_ASSIGN(Image8 image, decode_frame(capture, camera, frame));
  STGS_ASSIGN(const Image8 mask, load_mask(capture, camera, frame));
  if (mask.data.empty()) return missing_mask(capture, camera, frame);
  for (std::size_t i = 0; i < mask.data.size(); ++i) {
    if (mask.data[i] < kMinMask) std::copy_n(colour.data(), 3, image.data.data() + 3 * i);
  }
  return image;
}

Result<Image8> load_frame(const PreparedCapture& capture, const Camera& camera, int frame) {
  return capture.mask_background ? load_foreground(capture, camera, frame, *capture.mask_background)
                                 : decode_frame(capture, camera, frame);
}

Result<std::shared_ptr<const Image8>> load_shared_frame(const PreparedCapture& capture,
                                                        const Camera& camera, int frame) {
  if (!capture.mask_background) {
    if (auto image = frame_in_memory(capture, camera, frame)) return image;
  }
  STGS_ASSIGN(Image8 image, load_frame(capture, camera, frame));
  return std::make_shared<const Image8>(std::move(image));
}

Result<Image8> load_mask(const PreparedCapture& capture, const Camera& camera, int frame) {
  if (const auto mask = mask_in_memory(capture, camera, frame)) return *mask;
  if (!has_mask(capture, camera, frame)) return Image8{};
  const std::string path = capture.mask_path(camera, frame);
  STGS_ASSIGN(const std::unique_ptr<ByteSource> file, open_file_of(capture, path));
  STGS_ASSIGN(Image8 mask, read_image8(*file, 1));
  if (mask.width != camera.width || mask.height != camera.height) {
    return invalid_file(
        "{}: mask of camera '{}' frame {} has the wrong size (expected {}x{}, got {}x{})", path,
        camera.name, frame, camera.width, camera.height, mask.width, mask.height);
  }
  return mask;
}

}  // namespace stgs::encoder
