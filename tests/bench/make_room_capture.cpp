// SPDX-License-Identifier: Apache-2.0
// Writes a synthetic capture of any length (tests/fixtures/moving_room.h): cameras.json and a
// Motion JPEG video per camera, which `stgs encode` and `stgs live` read. With --images, it writes
// only these frames of the test cameras, as NAME-NNNNNN.png, and the camera files NAME.json.
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <string_view>

#include "fixtures/moving_room.h"
#include "stgs/encoder/camera_json.h"
#include "stgs/format/parallel.h"

using namespace stgs;

namespace {

namespace fs = std::filesystem;

constexpr double kJpegQuality = 95;

struct Options {
  std::string folder;
  test::RoomRig rig;
  double fps = 10;
  int frames = 100;
  std::vector<int> images;
};

template <typename Number>
bool parse(std::string_view text, Number& number) {
  const char* end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, number);
  return result.ec == std::errc() && result.ptr == end;
}

bool parse_images(std::string_view text, std::vector<int>& images) {
  while (true) {
    const std::size_t comma = text.find(',');
    if (!parse(text.substr(0, comma), images.emplace_back()) || images.back() < 0) return false;
    if (comma == std::string_view::npos) return true;
    text.remove_prefix(comma + 1);
  }
}

bool parse_option(std::string_view name, std::string_view value, Options& options) {
  test::RoomRig& rig = options.rig;
  if (name == "--cameras") return parse(value, rig.cameras) && rig.cameras >= 2;
  if (name == "--test-cameras") return parse(value, rig.test_cameras) && rig.test_cameras >= 0;
  if (name == "--arc") return parse(value, rig.arc) && rig.arc > 0;
  if (name == "--fps") return parse(value, options.fps) && options.fps > 0;
  if (name == "--frames") return parse(value, options.frames) && options.frames > 0;
  if (name == "--images") return parse_images(value, options.images);
  const std::size_t cross = value.find('x');
  return name == "--size" && cross != std::string_view::npos &&
         parse(value.substr(0, cross), rig.width) && parse(value.substr(cross + 1), rig.height) &&
         rig.width > 0 && rig.height > 0;
}

bool parse(int argc, char** argv, Options& options) {
  if (argc % 2 != 0) return false;
  options.folder = argv[1];
  for (int i = 2; i < argc; i += 2) {
    if (!parse_option(argv[i], argv[i + 1], options)) return false;
  }
  return true;
}

cv::Mat to_bgr(encoder::Image8& image) {
  cv::Mat bgr;
  cv::cvtColor(cv::Mat(image.height, image.width, CV_8UC3, image.data.data()), bgr,
               cv::COLOR_RGB2BGR);
  return bgr;
}

Status write_text(const std::string& path, const nlohmann::ordered_json& json) {
  std::ofstream file(path);
  file << json.dump(2) << '\n';
  file.close();
  return file ? Status() : io_error("{}: cannot write", path);
}

// The rig in the format of the layout "videos".
Status write_rig(const Options& options, const std::vector<encoder::Camera>& cameras) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const encoder::Camera& camera : cameras) {
    nlohmann::ordered_json pose = nlohmann::ordered_json::array();
    for (int r = 0; r < 3; ++r) {
      const double* row = camera.rotation + 3 * r;
      pose.push_back({row[0], row[1], row[2], camera.translation[r]});
    }
    list.push_back({{"name", camera.name},
                    {"width", camera.width},
                    {"height", camera.height},
                    {"K", {{camera.fx, 0, camera.cx}, {0, camera.fy, camera.cy}, {0, 0, 1}}},
                    {"w2c", std::move(pose)},
                    {"test", camera.test}});
  }
  return write_text(options.folder + "/cameras.json",
                    {{"fps", options.fps}, {"metric", true}, {"cameras", std::move(list)}});
}

// OpenCV reports no errors of writing: counts the frames of the file.
Status check_video(const std::string& path, int frames) {
  cv::VideoCapture video(path, cv::CAP_FFMPEG);
  const int found = video.isOpened() ? static_cast<int>(video.get(cv::CAP_PROP_FRAME_COUNT)) : 0;
  if (found == frames) return {};
  return io_error("{}: cannot write: the file has {} of {} frames", path, found, frames);
}

Status write_video(const Options& options, const test::RoomView& view) {
  const encoder::Camera& camera = view.camera();
  const std::string path = fmt::format("{}/videos/{}.avi", options.folder, camera.name);
  cv::VideoWriter video(path, cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'),
                        options.fps, cv::Size(camera.width, camera.height));
  if (!video.isOpened()) return io_error("{}: cannot write", path);
  video.set(cv::VIDEOWRITER_PROP_QUALITY, kJpegQuality);
  for (int frame = 0; frame < options.frames; ++frame) {
    encoder::Image8 image = view.render(frame / options.fps);
    video.write(to_bgr(image));
  }
  video.release();
  return check_video(path, options.frames);
}

Status write_images(const Options& options, const test::RoomView& view) {
  const std::string stem = options.folder + "/" + view.camera().name;
  STGS_TRY(write_text(stem + ".json", encoder::camera_to_json(view.camera())));
  for (const int frame : options.images) {
    encoder::Image8 image = view.render(frame / options.fps);
    const std::string path = fmt::format("{}-{:06}.png", stem, frame);
    if (!cv::imwrite(path, to_bgr(image))) return io_error("{}: cannot write", path);
  }
  return {};
}

Status run(const Options& options) {
  std::vector<encoder::Camera> cameras = test::room_cameras(options.rig);
  fs::create_directories(options.folder + (options.images.empty() ? "/videos" : ""));
  if (options.images.empty())
    STGS_TRY(write_rig(options, cameras));
  else
    std::erase_if(cameras, [](const encoder::Camera& camera) { return !camera.test; });
  cv::setNumThreads(1);  // cameras are written in parallel
  const auto texture = std::make_shared<const test::NoiseTexture>();
  std::vector<Status> written(cameras.size());
  parallel_for(std::size_t{0}, cameras.size(), [&](std::size_t c) {
    const test::RoomView view(texture, cameras[c]);
    written[c] = options.images.empty() ? write_video(options, view) : write_images(options, view);
  });
  for (const Status& status : written) STGS_TRY(status);
  return {};
}

}  // namespace

int main(int argc, char** argv) try {
  Options options;
  if (!parse(argc, argv, options)) {
    std::fprintf(stderr,
                 "usage: make_room_capture FOLDER [--cameras N] [--test-cameras N] [--arc DEGREES] "
                 "[--size WxH] [--fps F] [--frames N] [--images FRAME,...]\n");
    return 1;
  }
  const Status status = run(options);
  if (!status.ok()) std::fprintf(stderr, "make_room_capture: %s\n", status.message().c_str());
  return static_cast<int>(status.code());
} catch (const std::exception& error) {
  std::fprintf(stderr, "make_room_capture: %s\n", error.what());
  return 4;
}
