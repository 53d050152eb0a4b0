// SPDX-License-Identifier: Apache-2.0
#include "frame_reader.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "file_kind.h"
#include "stgs/encoder/image_file.h"

namespace stgs::encoder {
namespace {

constexpr int kImageFlags = cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION;

Result<cv::VideoCapture> open_video(const CaptureFolder& files, const SourceCamera& camera) {
  const std::string& path = camera.video;
  if (!files.exists(path)) return io_error("{}: video of camera '{}' not found", path, camera.name);
  if (files.kind(path) == CaptureFolder::Kind::kOther) {
    return io_error("{}: video of camera '{}': not a regular file", path, camera.name);
  }
  STGS_ASSIGN(const CaptureFile file, files.open_file(path));
  std::vector<std::uint8_t> begin(kVideoProbeBytes);
  const ssize_t got = ::pread(file.descriptor(), begin.data(), begin.size(), 0);
  if (got < 0) return io_error("{}: cannot read: {}", path, system_message(errno));
  begin.resize(static_cast<std::size_t>(got));
  STGS_TRY(check_video_kind(begin, path, fmt::format("video of camera '{}'", camera.name)));
  // By the descriptor, so that FFmpeg reads the file that was checked.
  cv::VideoCapture video(file.name(), cv::CAP_FFMPEG);
  if (!video.isOpened()) {
    return invalid_file(
        "{}: cannot open the video of camera '{}' (damaged, its codec is missing from FFmpeg, or "
        "/proc is not mounted)",
        path, camera.name);
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
Status check_complete(const std::vector<std::uint8_t>& bytes, const std::string& path,
                      const std::string& what) {
  if (!is_truncated_jpeg(bytes)) return {};
  return invalid_file(
      "{}: {}: truncated JPEG (no end-of-image marker in {} bytes); copy the file again, or "
      "re-encode it if its writer omits the marker",
      path, what, bytes.size());
}

// Decodes an image frame of any size.
Result<cv::Mat> decode_image(const CaptureFolder& files, const SourceCamera& camera, int frame) {
  const std::string& path = camera.images[static_cast<std::size_t>(frame)];
  const std::string what = fmt::format("camera '{}' frame {}", camera.name, frame);
  return decode_file(files, path, what, kImageFlags);
}

// Returns the number of frames of a video after its first was read.
Result<int> count_frames(cv::VideoCapture& video, const std::string& path) {
  const double stated = std::round(video.get(cv::CAP_PROP_FRAME_COUNT));
  if (stated > kCaptureLimits.frames) {
    return check_frame_limit(static_cast<std::uint64_t>(std::min(stated, 1e18)), path);
  }
  if (stated > 0) return static_cast<int>(stated);
  // Some containers do not state their length: count the frames.
  int frames = 1;
  while (frames <= kCaptureLimits.frames && video.grab()) ++frames;
  STGS_TRY(check_frame_limit(static_cast<std::uint64_t>(frames), path));
  return frames;
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

Result<cv::Mat> decode_file(const CaptureFolder& files, const std::string& path,
                            const std::string& what, int flags) {
  if (!files.exists(path)) return io_error("{}: {} not found", path, what);
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, files.read(path, kCaptureLimits.file_bytes));
  STGS_TRY(check_complete(bytes, path, what));
  STGS_TRY(check_image_kind(bytes, path, what));
  STGS_TRY(check_jpeg(bytes, path));
  try {
    cv::Mat image = cv::imdecode(bytes, flags);
    if (!image.empty()) STGS_TRY(check_image_size(image.cols, image.rows, path));
    if (!image.empty()) return image;
  } catch (const cv::Exception& error) {  // for example, a size beyond OpenCV's limit
    return invalid_file("{}: cannot decode {}: {}", path, what, error.err);
  }
  return invalid_file("{}: cannot decode {}", path, what);
}

Result<FrameInfo> probe_frames(const CaptureFolder& files, const SourceCamera& camera) {
  FrameInfo info;
  if (camera.video.empty()) {
    STGS_ASSIGN(const cv::Mat image, decode_image(files, camera, 0));
    info.width = image.cols;
    info.height = image.rows;
    info.frames = static_cast<int>(camera.images.size());
    return info;
  }
  STGS_ASSIGN(cv::VideoCapture video, open_video(files, camera));
  cv::Mat image;
  if (!video.read(image) || image.empty()) {
    return invalid_file(
        "{}: cannot decode frame 0 of camera '{}' (truncated, or not a video that FFmpeg reads); "
        "copy the file again",
        camera.video, camera.name);
  }
  STGS_TRY(check_image_size(image.cols, image.rows, camera.video));
  info.width = image.cols;
  info.height = image.rows;
  info.fps = video.get(cv::CAP_PROP_FPS);
  STGS_ASSIGN(info.frames, count_frames(video, camera.video));
  return info;
}

Result<cv::Mat> read_image(const CaptureFolder& files, const SourceCamera& camera, int frame,
                           int width, int height) {
  STGS_ASSIGN(cv::Mat image, decode_image(files, camera, frame));
  STGS_TRY(check_size(camera.images[static_cast<std::size_t>(frame)], camera, frame, image, width,
                      height));
  return image;
}

Result<std::unique_ptr<VideoReader>> VideoReader::open(const CaptureFolder& files,
                                                       const SourceCamera& camera, int first) {
  STGS_ASSIGN(cv::VideoCapture video, open_video(files, camera));
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
