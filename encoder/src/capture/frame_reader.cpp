// SPDX-License-Identifier: Apache-2.0
#include "frame_reader.h"

#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "capture_files.h"
#include "stgs/encoder/image_file.h"

namespace stgs::encoder {
namespace {

constexpr int kImageFlags = cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION;

Result<cv::VideoCapture> open_video(const SourceCamera& camera) {
  if (!std::filesystem::exists(camera.video)) {
    return io_error("{}: video of camera '{}' not found", camera.video, camera.name);
  }
  if (!std::filesystem::is_regular_file(camera.video)) {  // a pipe would block
    return io_error("{}: video of camera '{}': not a regular file", camera.video, camera.name);
  }
  cv::VideoCapture video(camera.video, cv::CAP_FFMPEG);
  if (!video.isOpened()) {
    return invalid_file(
        "{}: cannot open the video of camera '{}' (damaged, or its codec is missing from FFmpeg)",
        camera.video, camera.name);
  }
  return video;
}

Status check_size(const std::string& path, const SourceCamera& camera, int frame,
                  const cv::Mat& image, int width, int height) {
  if (image.cols == width && image.rows == height) return {};
  return invalid_file(
      "{}: camera '{}' frame {} differs in size from the frames before it (expected {}x{}, got "
      "{}x{})",
      path, camera.name, frame, width, height, image.cols, image.rows);
}

// kInvalidFile for a truncated JPEG, which OpenCV decodes to a partly grey image.
Status check_complete(const std::string& path, const std::string& what) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, read_whole_file(path));
  if (!is_truncated_jpeg(bytes)) return {};
  return invalid_file(
      "{}: {}: truncated JPEG (no end-of-image marker in {} bytes); copy the file again, or "
      "re-encode it if its writer omits the marker",
      path, what, bytes.size());
}

// Decodes an image frame of any size.
Result<cv::Mat> decode_image(const SourceCamera& camera, int frame) {
  const std::string& path = camera.images[static_cast<std::size_t>(frame)];
  const std::string what = fmt::format("camera '{}' frame {}", camera.name, frame);
  return decode_file(path, what, kImageFlags);
}

class OpenCvVideoReader final : public VideoReader {
 public:
  OpenCvVideoReader(const cv::VideoCapture& video, const SourceCamera& camera, int next)
      : video_(video), camera_(camera), next_(next) {}

  Result<cv::Mat> next(int width, int height) override {
    cv::Mat image;  // not reused: the caller may still hold the previous frame
    if (!video_.read(image) || image.empty()) {
      return invalid_file(
          "{}: video of camera '{}' ends at frame {}, before its stated length (truncated or "
          "damaged); select the frames before it with --frames",
          camera_.video, camera_.name, next_);
    }
    STGS_TRY(check_size(camera_.video, camera_, next_, image, width, height));
    ++next_;
    return image;
  }

 private:
  cv::VideoCapture video_;
  const SourceCamera& camera_;
  int next_;
};

}  // namespace

Result<cv::Mat> decode_file(const std::string& path, const std::string& what, int flags) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) return io_error("{}: {} not found", path, what);
  STGS_TRY(check_complete(path, what));
  try {
    cv::Mat image = cv::imread(path, flags);
    if (!image.empty()) return image;
  } catch (const cv::Exception& error) {  // for example, a size beyond OpenCV's limit
    return invalid_file("{}: cannot decode {}: {}", path, what, error.err);
  }
  return invalid_file("{}: cannot decode {}", path, what);
}

Result<FrameInfo> probe_frames(const SourceCamera& camera) {
  FrameInfo info;
  if (camera.video.empty()) {
    STGS_ASSIGN(const cv::Mat image, decode_image(camera, 0));
    info.width = image.cols;
    info.height = image.rows;
    info.frames = static_cast<int>(camera.images.size());
    return info;
  }
  STGS_ASSIGN(cv::VideoCapture video, open_video(camera));
  cv::Mat image;
  if (!video.read(image) || image.empty()) {
    return invalid_file(
        "{}: cannot decode frame 0 of camera '{}' (truncated, or not a video that FFmpeg reads); "
        "copy the file again",
        camera.video, camera.name);
  }
  info.width = image.cols;
  info.height = image.rows;
  info.fps = video.get(cv::CAP_PROP_FPS);
  info.frames = static_cast<int>(std::lround(video.get(cv::CAP_PROP_FRAME_COUNT)));
  if (info.frames > 0) return info;
  // Some containers do not state their length: count the frames.
  info.frames = 1;
  while (video.grab()) ++info.frames;
  return info;
}

Result<cv::Mat> read_image(const SourceCamera& camera, int frame, int width, int height) {
  STGS_ASSIGN(cv::Mat image, decode_image(camera, frame));
  STGS_TRY(check_size(camera.images[static_cast<std::size_t>(frame)], camera, frame, image, width,
                      height));
  return image;
}

Result<std::unique_ptr<VideoReader>> VideoReader::open(const SourceCamera& camera, int first) {
  STGS_ASSIGN(cv::VideoCapture video, open_video(camera));
  for (int frame = 0; frame < first; ++frame) {
    if (video.grab()) continue;
    return invalid_file(
        "{}: video of camera '{}' ends at frame {}, before its stated length (truncated or "
        "damaged)",
        camera.video, camera.name, frame);
  }
  return std::unique_ptr<VideoReader>(
      std::make_unique<OpenCvVideoReader>(std::move(video), camera, first));
}

}  // namespace stgs::encoder
