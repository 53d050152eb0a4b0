// SPDX-License-Identifier: Apache-2.0
// Reads the frames of one source camera in order.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>

#include "source_capture.h"
#include "video_decoder.h"

namespace stgs::encoder {

struct FrameInfo {
  int width = 0, height = 0;  // pixels
  int frames = 0;
  double fps = 0;  // 0: images, which have no rate
};

// Decodes an image file with the flags of cv::imread. `what` describes the image in errors, which
// start with the path. kIo if the file is missing, kInvalidFile if it cannot be decoded or
// check_image_kind() (file_kind.h) refuses it.
Result<cv::Mat> decode_file(const CaptureFolder& files, const std::string& path,
                            const std::string& what, int flags);

// Decodes the first frame, on the CPU, and returns the properties of all. Errors name file and
// camera. kInvalidFile for more than kCaptureLimits.frames, for a video that check_video_file()
// refuses or whose header states too many pixels, and for one that states more frames than its
// bytes can hold: fewer than 8 bytes per frame, or more than 2^20 pixels per byte.
Result<FrameInfo> probe_frames(const CaptureFolder& files, const SourceCamera& camera);

// Decodes an image frame to 8-bit BGR. EXIF orientation is ignored, as calibration tools and other
// decoders ignore it. kInvalidFile if the size is not width x height.
Result<cv::Mat> read_image(const CaptureFolder& files, const SourceCamera& camera, int frame,
                           int width, int height);

class FrameMapping;  // camera_plan.h

// Returns the current frame of a decoder as 8-bit BGR, changed by a mapping: on the GPU of the
// mapping, if that can convert it.
Result<cv::Mat> mapped_frame(VideoDecoder& decoder, const FrameMapping& mapping);

// Reads a video from front to back. Not thread-safe; separate readers are independent.
class VideoReader {
 public:
  // Opens the video of the camera, positioned before frame `first`. Decodes the preceding frames,
  // or, if they are many, only those from a key frame on where this is certain to be exact. Keeps
  // a reference to `camera`. Errors of `decoding` as in VideoDecoder::open().
  static Result<std::unique_ptr<VideoReader>> open(const CaptureFolder& files,
                                                   const SourceCamera& camera, int first,
                                                   const VideoDecoding& decoding = {});
  virtual ~VideoReader() = default;
  // Decodes the next frame to 8-bit BGR, and changes it by `mapping`; null: not. kInvalidFile at
  // the end of the video, if the size is not width x height, or if the file repeats stored frames:
  // they had more than twice its bytes and 16 MiB so far.
  virtual Result<cv::Mat> next(int width, int height, const FrameMapping* mapping = nullptr) = 0;
  // Returns how the latest frame was decoded.
  virtual DecodedBy decoded_by() const = 0;
};

}  // namespace stgs::encoder
