// SPDX-License-Identifier: Apache-2.0
#include "frame_reader.h"

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <span>

#include "camera_plan.h"
#include "file_kind.h"
#include "png_text.h"
#include "stgs/encoder/image_file.h"
#include "video_decoder.h"
#include "video_file.h"

namespace stgs::encoder {
namespace {

constexpr int kImageFlags = cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION;

// The fewest bytes of a frame of a video, and the most pixels for each byte. An all-black
// AV1 video of 3840x2160 pixels has 36 bytes per frame, 232,000 pixels per byte.
constexpr std::uint64_t kMinFrameBytes = 8;
constexpr std::uint64_t kMaxPixelsPerByte = std::uint64_t{1} << 20;
// Stored frames have at most twice the bytes of the file, and this: a table may list a frame that
// repeats more than once.
constexpr std::uint64_t kRepeatedBytes = std::uint64_t{16} << 20;

// Of the frames before the first that is read, up to this many are all decoded: this also finds
// damage in them.
constexpr int kMaxDecoded = 256;

// Adds the sizes of the stored frames that are decoded. The table of a container may list one any
// number of times, in 4 bytes each.
class StoredFrames {
 public:
  // `bytes`: of the file, without holes.
  explicit StoredFrames(std::uint64_t bytes) : bytes_(bytes) {}

  // Call before each frame is decoded. kInvalidFile, with the reason, if the frames so far have too
  // many bytes for the file (kRepeatedBytes), or the frame is an image with long texts or oversized
  // headers.
  Status check(std::span<const std::uint8_t> stored) {
    if (has_long_png_text(stored)) return invalid_file("it is a PNG image with long texts");
    if (has_oversized_jpeg(stored))
      return invalid_file("it is a JPEG image that states more pixels than its bytes can hold");
    used_ += stored.size();
    if (used_ <= 2 * bytes_ + kRepeatedBytes) return {};
    return invalid_file(
        "the file states the same stored frames many times: {} bytes of frames in {}", used_,
        bytes_);
  }

 private:
  std::uint64_t bytes_, used_ = 0;
};

struct OpenVideo {
  std::unique_ptr<VideoDecoder> decoder;
  std::uint64_t bytes;  // of the file, without holes
};

// `camera` must outlive the video.
Result<OpenVideo> open_video(const CaptureFolder& files, const SourceCamera& camera,
                             const VideoDecoding& decoding) {
  const std::string& path = camera.video;
  if (!files.exists(path)) return io_error("{}: video of camera '{}' not found", path, camera.name);
  if (files.kind(path) == CaptureFolder::Kind::kOther) {
    return io_error("{}: video of camera '{}': not a regular file", path, camera.name);
  }
  STGS_ASSIGN(const CaptureFile file, files.open_file(path));
  const std::string what = fmt::format("video of camera '{}'", camera.name);
  STGS_ASSIGN(const std::uint64_t bytes, check_video_file(file, path, what));
  // By the descriptor, so that FFmpeg reads the file that was checked.
  STGS_ASSIGN(auto decoder, VideoDecoder::open(
                                file.name(), path + ": " + what,
                                [frames = StoredFrames(bytes)](auto stored) mutable {
                                  return frames.check(stored);
                                },
                                decoding));
  // Before the decoder gets a frame. Containers may state no size.
  const VideoTrack& track = decoder->track();
  if (track.width > 0 && track.height > 0) {
    STGS_TRY(check_image_size(track.width, track.height, path));
  }
  return OpenVideo{std::move(decoder), bytes};
}

Status check_size(const std::string& path, const SourceCamera& camera, int frame, cv::Size size,
                  int width, int height) {
  if (size == cv::Size(width, height)) return {};
  return invalid_file(
      "{}: camera '{}' frame {} differs in size from the frames before it (expected {}x{}, got "
      "{}x{})",
      path, camera.name, frame, width, height, size.width, size.height);
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

// Returns the number of frames of a video after its first was decoded.
Result<int> count_frames(OpenVideo& video, const SourceCamera& camera, const FrameInfo& info) {
  const std::int64_t stated = video.decoder->track().frames;
  if (stated > 0) {
    STGS_TRY(check_frame_limit(static_cast<std::uint64_t>(stated), camera.video));
    STGS_TRY(check_frame_bytes(camera, static_cast<int>(stated), info, video.bytes));
    return static_cast<int>(stated);
  }
  // Some containers do not state their length: count the frames.
  int frames = 1;
  while (frames <= kCaptureLimits.frames) {
    STGS_ASSIGN(const bool has_frame, video.decoder->advance());
    if (!has_frame) break;
    STGS_TRY(check_frame_bytes(camera, ++frames, info, video.bytes));
  }
  STGS_TRY(check_frame_limit(static_cast<std::uint64_t>(frames), camera.video));
  return frames;
}

Status ends_at(const SourceCamera& camera, int frame) {
  return invalid_file(
      "{}: video of camera '{}' ends at frame {}, before its stated length (truncated or damaged); "
      "select the frames before it with --frames",
      camera.video, camera.name, frame);
}

class DecodingReader final : public VideoReader {
 public:
  DecodingReader(std::unique_ptr<VideoDecoder> decoder, const SourceCamera& camera, int next)
      : decoder_(std::move(decoder)), camera_(camera), next_(next) {}

  Result<cv::Mat> next(int width, int height, const FrameMapping* mapping) override {
    STGS_ASSIGN(const bool has_frame, decoder_->advance());
    if (!has_frame) return ends_at(camera_, next_);
    STGS_TRY(check_size(camera_.video, camera_, next_, decoder_->size(), width, height));
    ++next_;
    return mapping == nullptr ? decoder_->image() : mapped_frame(*decoder_, *mapping);
  }
  DecodedBy decoded_by() const override { return decoder_->decoded_by(); }

 private:
  std::unique_ptr<VideoDecoder> decoder_;
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
  STGS_ASSIGN(OpenVideo video, open_video(files, camera, {}));
  STGS_ASSIGN(const bool has_frame, video.decoder->advance());
  if (!has_frame) {
    return invalid_file("{}: video of camera '{}' has no frame; copy the file again", camera.video,
                        camera.name);
  }
  STGS_ASSIGN(const cv::Mat image, video.decoder->image());
  info.width = image.cols;
  info.height = image.rows;
  info.fps = video.decoder->track().fps;
  STGS_ASSIGN(info.frames, count_frames(video, camera, info));
  return info;
}

Result<cv::Mat> read_image(const CaptureFolder& files, const SourceCamera& camera, int frame,
                           int width, int height) {
  STGS_ASSIGN(cv::Mat image, decode_image(files, camera, frame));
  STGS_TRY(check_size(camera.images[static_cast<std::size_t>(frame)], camera, frame, image.size(),
                      width, height));
  return image;
}

Result<cv::Mat> mapped_frame(VideoDecoder& decoder, const FrameMapping& mapping) {
  if (mapping.is_on_gpu()) {
    if (const auto yuv = decoder.yuv()) return mapping.frame(*yuv);
  }
  STGS_ASSIGN(const cv::Mat image, decoder.image());
  return mapping.frame(image);
}

Result<std::unique_ptr<VideoReader>> VideoReader::open(const CaptureFolder& files,
                                                       const SourceCamera& camera, int first,
                                                       const VideoDecoding& decoding) {
  STGS_ASSIGN(OpenVideo video, open_video(files, camera, decoding));
  bool skipped = false;
  if (first > kMaxDecoded) {
    STGS_ASSIGN(skipped, video.decoder->skip_to(first));
    if (!skipped) {
      STGS_ASSIGN(video, open_video(files, camera, decoding));
    }
  }
  for (int frame = 0; frame < first && !skipped; ++frame) {
    STGS_ASSIGN(const bool has_frame, video.decoder->advance());
    if (!has_frame) return ends_at(camera, frame);
  }
  return std::unique_ptr<VideoReader>(
      std::make_unique<DecodingReader>(std::move(video.decoder), camera, first));
}

}  // namespace stgs::encoder
