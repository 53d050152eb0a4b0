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

constexpr int kPictureFlags = cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION;

Result<cv::VideoCapture> open_video(const SourceCamera& camera) {
  if (!std::filesystem::exists(camera.video)) {
    return io_error("{}: the video of camera '{}' is missing", camera.video, camera.name);
  }
  cv::VideoCapture video(camera.video, cv::CAP_FFMPEG);
  if (!video.isOpened()) {
    return invalid_file(
        "{}: cannot open the video of camera '{}' (damaged, or a codec that "
        "FFmpeg here lacks)",
        camera.video, camera.name);
  }
  return video;
}

Status check_size(const std::string& path, const SourceCamera& camera, int frame,
                  const cv::Mat& image, int width, int height) {
  if (image.cols == width && image.rows == height) return {};
  return invalid_file(
      "{}: camera '{}' frame {} is {}x{}, but the camera's frames before it are "
      "{}x{}; a camera's frames must have one size",
      path, camera.name, frame, image.cols, image.rows, width, height);
}

// kInvalidFile for a JPEG that was cut short, of which OpenCV makes a picture that is partly grey.
Status check_whole(const std::string& path, const std::string& what) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, read_whole_file(path));
  if (!is_truncated_jpeg(bytes)) return {};
  return invalid_file(
      "{}: {} cannot be decoded: in {} bytes of JPEG there is no end-of-image marker: it was cut "
      "short, or its writer left that out; copy it again, or write it anew",
      path, what, bytes.size());
}

// Decodes the camera's picture of a frame, of any size.
Result<cv::Mat> decode_picture(const SourceCamera& camera, int frame) {
  const std::string& path = camera.images[static_cast<std::size_t>(frame)];
  const std::string what = fmt::format("camera '{}' frame {}", camera.name, frame);
  return decode_file(path, what, kPictureFlags);
}

class OpenCvVideoReader final : public VideoReader {
 public:
  OpenCvVideoReader(cv::VideoCapture video, const SourceCamera& camera, int next)
      : video_(std::move(video)), camera_(camera), next_(next) {}

  Result<cv::Mat> next(int width, int height) override {
    cv::Mat image;  // a new one: the last may still be in use
    if (!video_.read(image) || image.empty()) {
      return invalid_file(
          "{}: camera '{}' ends at frame {}, before the length that it states: it "
          "is truncated or damaged; ask for the frames before with --frames",
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
  if (!std::filesystem::exists(path, ignored)) return io_error("{}: {} is missing", path, what);
  STGS_TRY(check_whole(path, what));
  try {
    cv::Mat image = cv::imread(path, flags);
    if (!image.empty()) return image;
  } catch (const cv::Exception& error) {  // such as a size beyond OpenCV's limit
    return invalid_file("{}: {} cannot be decoded: {}", path, what, error.err);
  }
  return invalid_file("{}: {} cannot be decoded", path, what);
}

Result<FrameInfo> probe_frames(const SourceCamera& camera) {
  FrameInfo info;
  if (camera.video.empty()) {
    STGS_ASSIGN(const cv::Mat image, decode_picture(camera, 0));
    info.width = image.cols;
    info.height = image.rows;
    info.frames = static_cast<int>(camera.images.size());
    return info;
  }
  STGS_ASSIGN(cv::VideoCapture video, open_video(camera));
  cv::Mat image;
  if (!video.read(image) || image.empty()) {
    return invalid_file(
        "{}: cannot decode frame 0 of camera '{}': truncated, or no video that FFmpeg reads; copy "
        "it "
        "again",
        camera.video, camera.name);
  }
  info.width = image.cols;
  info.height = image.rows;
  info.fps = video.get(cv::CAP_PROP_FPS);
  info.frames = static_cast<int>(std::lround(video.get(cv::CAP_PROP_FRAME_COUNT)));
  if (info.frames > 0) return info;
  // Some containers do not state their length.
  info.frames = 1;
  while (video.grab()) ++info.frames;
  return info;
}

Result<cv::Mat> read_picture(const SourceCamera& camera, int frame, int width, int height) {
  STGS_ASSIGN(cv::Mat image, decode_picture(camera, frame));
  STGS_TRY(check_size(camera.images[static_cast<std::size_t>(frame)], camera, frame, image, width,
                      height));
  return image;
}

Result<std::unique_ptr<VideoReader>> VideoReader::open(const SourceCamera& camera, int first) {
  STGS_ASSIGN(cv::VideoCapture video, open_video(camera));
  for (int frame = 0; frame < first; ++frame) {
    if (video.grab()) continue;
    return invalid_file(
        "{}: camera '{}' ends at frame {}, before the length that it states: it is "
        "truncated or damaged",
        camera.video, camera.name, frame);
  }
  return std::unique_ptr<VideoReader>(
      std::make_unique<OpenCvVideoReader>(std::move(video), camera, first));
}

}  // namespace stgs::encoder
