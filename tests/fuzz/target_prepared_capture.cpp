// SPDX-License-Identifier: Apache-2.0
// Prepared captures: capture.json, frames, masks and points. An input is a folder (packed_files.h).
#include "../fixtures/file_bytes.h"
#include "captures.h"
#include "png_file.h"
#include "stgs/encoder/camera_json.h"
#include "stgs/encoder/prepared_capture.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::encoder;

namespace {

constexpr int kWidth = 8, kHeight = 6, kFrames = 2;
constexpr int kFewFrames = 4;              // that are decoded of a camera
constexpr std::int64_t kFewPixels = 4096;  // of an image that is decoded

std::string content_of(const std::string& path) {
  const Bytes bytes = testing::bytes_of(path);
  return {bytes.begin(), bytes.end()};
}

PreparedCapture small_capture(const std::string& path) {
  PreparedCapture capture;
  capture.folder = path;
  for (int i = 0; i < 2; ++i) {
    Camera& camera = capture.cameras.emplace_back();
    camera.name = i == 0 ? "a" : "cam \u00e9";
    camera.width = kWidth;
    camera.height = kHeight;
    camera.fx = camera.fy = 9;
    camera.cx = 4;
    camera.cy = 3;
    camera.translation[0] = -0.5 * i;
    camera.test = i == 1;
  }
  capture.frames = kFrames;
  capture.time_base = {1, 30};
  capture.source = "videos";
  return capture;
}

std::vector<Bytes> seeds() {
  const PreparedCapture capture = small_capture(input_folder().path());
  input_folder().write({});
  require(write_prepared_capture(capture).ok(), "seeds can be written");
  const std::string points = input_folder().path() + "/points_static.ply";
  require(write_points(points, {{{1, 2, 3}, {4, 5, 6}, {0, 0, 0}, -1}}).ok(),
          "seeds can be written");
  PackedFiles packed;
  packed.files = {{"capture.json", content_of(input_folder().path() + "/capture.json")},
                  {"points_static.ply", content_of(points)}};
  const auto name = [&](const std::string& path) {
    return path.substr(input_folder().path().size() + 1);
  };
  for (const Camera& camera : capture.cameras) {
    for (int frame = 0; frame < kFrames; ++frame) {
      packed.files.push_back(
          {name(capture.frame_path(camera, frame)), tiny_png(kWidth, kHeight, 3)});
      packed.files.push_back(
          {name(capture.mask_path(camera, frame)), tiny_png(kWidth, kHeight, 1)});
    }
  }
  PackedFiles linked = packed;
  linked.files.push_back({"frames/cam \u00e9/000000.png@", "../../../outside.png"});
  std::rotate(linked.files.begin(), linked.files.end() - 1, linked.files.end());
  return {pack_files(packed), pack_files(linked)};
}

std::vector<Unit> units(View input) {
  return file_units(input);
}

// Values of JSON, one image with its file and the decoder's copy, and points.
std::uint64_t memory(View input) {
  return 256 * input.size() + (128 << 10);
}

void check_image(const Camera& camera, const Result<Image8>& image, bool optional) {
  check_error(image.status());
  if (!image.ok() || (optional && image->data.empty())) return;
  require(image->width == camera.width && image->height == camera.height,
          "an image has the size of its camera");
  require(image->data.size() == std::size_t{1} * static_cast<std::size_t>(image->channels) *
                                    static_cast<std::size_t>(camera.width) *
                                    static_cast<std::size_t>(camera.height),
          "an image has all its pixels");
}

void check_files(const PreparedCapture& capture) {
  check_error(check_frame_files(capture, capture.cameras));
  for (const Camera& camera : capture.cameras) {
    for (int frame = 0; frame < std::min(capture.frames, kFewFrames); ++frame) {
      check_path(*capture.files, capture.frame_path(camera, frame));
      check_path(*capture.files, capture.mask_path(camera, frame));
      if (std::int64_t{1} * camera.width * camera.height > kFewPixels) continue;
      check_image(camera, load_frame(capture, camera, frame), false);
      check_image(camera, load_mask(capture, camera, frame), true);
    }
  }
  for (const char* name : {"points_static.ply", "points_dynamic.ply"}) {
    const auto file = open_file_of(capture, capture.folder + "/" + name);
    if (file.ok()) check_error(read_points(**file).status());
  }
}

void check_capture(const PreparedCapture& capture) {
  require(!capture.cameras.empty() && capture.cameras.size() <= kCaptureLimits.cameras,
          "the number of cameras is within the limit");
  require(capture.frames >= 1 && capture.frames <= kCaptureLimits.frames,
          "the number of frames is within the limit");
  require(capture.time_base.numerator > 0 && capture.time_base.denominator > 0,
          "the time base is positive");
  require(std::isfinite(capture.scene_radius) && capture.scene_radius > 0 && capture.extent > 0 &&
              capture.near_plane > 0,
          "the bounds are positive");
  for (const Camera& camera : capture.cameras) {
    require(check_camera(camera, "input").ok(), "a camera that is read is valid");
  }
}

// Writes the capture elsewhere and reads it again.
void check_round_trip(PreparedCapture capture) {
  capture.folder = input_folder().beside("");
  const Status written = write_prepared_capture(capture);
  require(written.ok(), "a capture that is read can be written");
  const auto again = read_prepared_capture(capture.folder);
  require(again.ok() && again->cameras.size() == capture.cameras.size() &&
              again->frames == capture.frames && again->first_frame == capture.first_frame &&
              again->near_plane == capture.near_plane && again->source == capture.source &&
              again->cameras.back().name == capture.cameras.back().name &&
              again->cameras.back().cx == capture.cameras.back().cx,
          "a capture round-trips");
}

}  // namespace

const Target stgs::fuzz::kTarget{"prepared_capture", seeds, nullptr, nullptr, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  input_folder().write(unpack_files({data, size}).files);
  const auto capture = read_prepared_capture(input_folder().path());
  check_error(capture.status());
  if (!capture.ok()) return 0;
  check_capture(*capture);
  check_files(*capture);
  check_round_trip(*capture);
  return 0;
}
