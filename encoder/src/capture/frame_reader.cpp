// SPDX-License-Identifier: Apache-2.0
#include "frame_reader.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <span>
#include <string_view>

#include "file_kind.h"
#include "png_text.h"
#include "stgs/encoder/image_file.h"
#include "video_file.h"

namespace stgs::encoder {
namespace {

constexpr int kImageFlags = cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION;

// The fewest bytes of a frame of a video, and the most pixels for each byte. An all-black
// AV1 video of 3840x2160 pixels has 36 bytes per frame, 232,000 pixels per byte.
constexpr std::uint64_t kMinFrameBytes = 8;
constexpr std::uint64_t kMaxPixelsPerByte = std::uint64_t{1} << 20;
// Stored frames have at most twice the bytes of the file, and this: FFmpeg repeats the parameters
// of the codec before each keyframe.
constexpr std::uint64_t kRepeatedBytes = std::uint64_t{16} << 20;
// A stored frame that cannot be read, although the decoder may accept it, counts as this share of
// the file, and at least as so many bytes.
constexpr std::uint64_t kUnreadShare = 64, kUnreadBytes = std::uint64_t{256} << 10;

struct OpenVideo {
  cv::VideoCapture capture;
  std::uint64_t bytes;  // of the file, without holes
};

Result<OpenVideo> open_video(const CaptureFolder& files, const SourceCamera& camera) {
  const std::string& path = camera.video;
  if (!files.exists(path)) return io_error("{}: video of camera '{}' not found", path, camera.name);
  if (files.kind(path) == CaptureFolder::Kind::kOther) {
    return io_error("{}: video of camera '{}': not a regular file", path, camera.name);
  }
  STGS_ASSIGN(const CaptureFile file, files.open_file(path));
  STGS_ASSIGN(const std::uint64_t bytes,
              check_video_file(file, path, fmt::format("video of camera '{}'", camera.name)));
  // By the descriptor, so that FFmpeg reads the file that was checked.
  cv::VideoCapture video(file.name(), cv::CAP_FFMPEG);
  if (!video.isOpened()) {
    return invalid_file(
        "{}: cannot open the video of camera '{}' (damaged, its codec is missing from FFmpeg, or "
        "/proc is not mounted)",
        path, camera.name);
  }
  // Before FFmpeg decodes a frame. Containers may state no size.
  const double width = video.get(cv::CAP_PROP_FRAME_WIDTH);
  const double height = video.get(cv::CAP_PROP_FRAME_HEIGHT);
  if (width > 0 && height > 0) {
    STGS_TRY(check_image_size(static_cast<int>(width), static_cast<int>(height), path));
  }
  return OpenVideo{video, bytes};
}

// Adds the sizes of the frames that are read. The table of a container may list a stored frame any
// number of times, in 4 bytes each.
class StoredFrames {
 public:
  // `camera` must outlive the object.
  static Result<StoredFrames> open(const CaptureFolder& files, const SourceCamera& camera) {
    STGS_ASSIGN(OpenVideo video, open_video(files, camera));
    if (!video.capture.set(cv::CAP_PROP_FORMAT, -1)) {  // the stored bytes, not decoded
      return unsupported("{}: this OpenCV cannot read the stored frames of camera '{}'",
                         camera.video, camera.name);
    }
    return StoredFrames(std::move(video), camera);
  }
  // Call before each frame is decoded. kInvalidFile if the frames so far have too many bytes for
  // the file (kRepeatedBytes), or the frame is an image with long texts or oversized headers.
  Status next() {
    cv::Mat stored;
    const bool has_frame = video_.capture.grab() && video_.capture.retrieve(stored);
    const std::span<const std::uint8_t> bytes(stored.data, stored.total() * stored.elemSize());
    if (has_frame && has_long_png_text(bytes)) return refused("PNG frames with long texts");
    if (has_frame && has_oversized_jpeg(bytes)) {
      return refused("JPEG frames that state more pixels than their bytes can hold");
    }
    used_ += has_frame ? bytes.size() : std::max(video_.bytes / kUnreadShare, kUnreadBytes);
    if (used_ <= 2 * video_.bytes + kRepeatedBytes) return {};
    return invalid_file(
        "{}: video of camera '{}' states the same stored frames many times, or damaged ones: {} "
        "bytes of frames in a file of {}; encode the video again",
        camera_->video, camera_->name, used_, video_.bytes);
  }

 private:
  Status refused(std::string_view what) const {
    return invalid_file("{}: video of camera '{}' has {}; encode the video again", camera_->video,
                        camera_->name, what);
  }

  StoredFrames(OpenVideo video, const SourceCamera& camera)
      : video_(std::move(video)), camera_(&camera) {}

  OpenVideo video_;
  const SourceCamera* camera_;
  std::uint64_t used_ = 0;  // bytes
};

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

// kInvalidFile for more frames than the bytes of the file can hold.
Status check_frame_bytes(const SourceCamera& camera, int frames, const FrameInfo& info,
                         std::uint64_t bytes) {
  const auto count = static_cast<std::uint64_t>(frames);
  const std::uint64_t pixels =
      count * static_cast<std::uint64_t>(info.width) * static_cast<std::uint64_t>(info.height);
  if (count <= bytes / kMinFrameBytes && pixels / kMaxPixelsPerByte <= bytes) return {};
  return invalid_file(
      "{}: video of camera '{}' states {} frames of {}x{} pixels, more than its {} bytes can hold; "
      "encode the video again",
      camera.video, camera.name, frames, info.width, info.height, bytes);
}

// Returns the number of frames of a video after its first was read, also from `stored`.
Result<int> count_frames(OpenVideo& video, StoredFrames& stored, const SourceCamera& camera,
                         const FrameInfo& info) {
  const double stated = std::round(video.capture.get(cv::CAP_PROP_FRAME_COUNT));
  if (stated > kCaptureLimits.frames) {
    return check_frame_limit(static_cast<std::uint64_t>(std::min(stated, 1e18)), camera.video);
  }
  if (stated > 0) {
    STGS_TRY(check_frame_bytes(camera, static_cast<int>(stated), info, video.bytes));
    return static_cast<int>(stated);
  }
  // Some containers do not state their length: count the frames.
  int frames = 1;
  while (frames <= kCaptureLimits.frames) {
    STGS_TRY(stored.next());
    if (!video.capture.grab()) break;
    STGS_TRY(check_frame_bytes(camera, ++frames, info, video.bytes));
  }
  STGS_TRY(check_frame_limit(static_cast<std::uint64_t>(frames), camera.video));
  return frames;
}

class OpenCvVideoReader final : public VideoReader {
 public:
  OpenCvVideoReader(const cv::VideoCapture& video, StoredFrames stored, const SourceCamera& camera,
                    int next)
      : video_(video), stored_(std::move(stored)), camera_(camera), next_(next) {}

  Result<cv::Mat> next(int width, int height) override {
    STGS_TRY(stored_.next());
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
  StoredFrames stored_;
  const SourceCamera& camera_;
  int next_;
};

}  // namespace

Result<cv::Mat> decode_file(const CaptureFolder& files, const std::string& path,
                            const std::string& what, int flags) {
  if (!files.exists(path)) return io_error("{}: {} not found", path, what);
  STGS_ASSIGN(std::vector<std::uint8_t> bytes, files.read(path, kCaptureLimits.file_bytes));
  STGS_TRY(check_complete(bytes, path, what));
  STGS_TRY(check_image_kind(bytes, path, what));
  STGS_TRY(check_jpeg(bytes, path));
  remove_png_text(bytes);
  try {
    cv::Mat image = cv::imdecode(bytes, flags);
    if (!image.empty()) STGS_TRY(check_image_size(image.cols, image.rows, path));
    if (!image.empty()) return image;
  } catch (const cv::Exception& error) {  // for example, a size beyond OpenCV's limit
    if (error.code == cv::Error::StsNoMem)
      return Status(StatusCode::kNoMemory, path + ": not enough memory to decode " + what);
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
  STGS_ASSIGN(StoredFrames stored, StoredFrames::open(files, camera));
  STGS_TRY(stored.next());
  STGS_ASSIGN(OpenVideo video, open_video(files, camera));
  cv::Mat image;
  if (!video.capture.read(image) || image.empty()) {
    return invalid_file(
        "{}: cannot decode frame 0 of camera '{}' (truncated, or not a video that FFmpeg reads); "
        "copy the file again",
        camera.video, camera.name);
  }
  STGS_TRY(check_image_size(image.cols, image.rows, camera.video));
  info.width = image.cols;
  info.height = image.rows;
  info.fps = video.capture.get(cv::CAP_PROP_FPS);
  STGS_ASSIGN(info.frames, count_frames(video, stored, camera, info));
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
  STGS_ASSIGN(OpenVideo video, open_video(files, camera));
  STGS_ASSIGN(StoredFrames stored, StoredFrames::open(files, camera));
  for (int frame = 0; frame < first; ++frame) {
    STGS_TRY(stored.next());
    if (video.capture.grab()) continue;
    return invalid_file(
        "{}: video of camera '{}' ends at frame {}, before its stated length (truncated or "
        "damaged)",
        camera.video, camera.name, frame);
  }
  return std::unique_ptr<VideoReader>(
      std::make_unique<OpenCvVideoReader>(video.capture, std::move(stored), camera, first));
}

}  // namespace stgs::encoder
