// SPDX-License-Identifier: Apache-2.0
// Decodes the frames of a video file with FFmpeg.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "geometry/frame_warp.h"
#include "stgs/format/status.h"
#include "video_device.h"

namespace stgs::encoder {

// Properties of a video that its file states. The size is that of the stored frames, before
// rotation, and 0 if the file does not state it.
struct VideoTrack {
  int width = 0, height = 0;  // pixels
  double fps = 0;             // 0: not stated
  std::int64_t frames = 0;    // 0: not stated
};

// How a frame was decoded.
struct DecodedBy {
  bool gpu = false;     // by NVDEC; false: by the CPU
  std::string refusal;  // why NVDEC does not decode the video; "": it does, or was not asked for
};

// The first video track of an MP4, MOV, Matroska, WebM or AVI file. Reads from front to back, on
// the calling thread. Errors: kNoMemory, kIo if the system fails, kUnsupported for features
// that FFmpeg lacks, else kInvalidFile. Not thread-safe; separate decoders are independent.
inline constexpr std::array<std::string_view, 6> kStreamSchemes = {"rtsp", "rtp",  "udp",
                                                                   "tcp",  "http", "https"};

class VideoDecoder {
 public:
  // Called with each stored frame before advance() decodes it. An error is a reason without path,
  // which advance() completes and returns.
  using CheckStored = std::function<Status(std::span<const std::uint8_t>)>;

  // Opens the file `name`. FFmpeg uses the protocol `file` and the demuxers above only, and decodes
  // frames only if it needs them to learn the format of common codecs. `label` begins messages.
  // kUnsupported, here or in advance(), if the device of `decoding` is required but cannot decode
  // the video. Frames are the same on the CPU and on the device.
  static Result<std::unique_ptr<VideoDecoder>> open(const std::string& name,
                                                    const std::string& label, CheckStored check,
                                                    VideoDecoding decoding = {});
  // Opens a live stream: a URL of kStreamSchemes, or the path of a named pipe. Formats: MPEG-TS,
  // RTP, Matroska, fragmented MP4, Motion JPEG, YUV4MPEG, and plain H.264 or HEVC. Calls return
  // kRuntime while `stopped` returns true. Damaged frames are skipped. A TCP connection without
  // data for five seconds ends the stream.
  static Result<std::unique_ptr<VideoDecoder>> open_stream(const std::string& url,
                                                           const std::string& label,
                                                           std::function<bool()> stopped,
                                                           VideoDecoding decoding = {});
  virtual ~VideoDecoder() = default;

  virtual const VideoTrack& track() const = 0;
  // Returns the time of the current frame that the file states, seconds; NaN: not stated.
  virtual double seconds() const = 0;
  // Positions a file that was just opened before frame `first`, in the order of presentation.
  // Decodes few of the frames before, so that damage in the others is not found.
  // Returns false if that is not certain to be exact: then the decoder is of no further use, and
  // advance() of another one has to decode them.
  virtual Result<bool> skip_to(int first) = 0;
  // Decodes the next frame in the order of presentation. Returns whether there is one. An error is
  // that of the first frame that cannot be decoded; all frames before it come first. kInvalidFile
  // for a frame of another size than the first.
  virtual Result<bool> advance() = 0;
  // Returns the size of image().
  virtual cv::Size size() const = 0;
  // Returns the current frame as 8-bit BGR, rotated as the file states (in steps of 90 degrees, as
  // players do). Chroma is interpolated, from its stated position. The matrix and range are the
  // stated ones. Where they are not stated, the matrix is BT.709 above 576 lines or from 1280
  // columns on, else BT.601, and the range is full for grey frames, else limited. Transfer
  // functions are not converted.
  virtual Result<cv::Mat> image() = 0;
  // Returns the current frame for a GPU, which converts it to the result of image(): valid until
  // the next call of advance(), and none if a GPU cannot convert it.
  virtual std::optional<geometry::YuvFrame> yuv() = 0;
  // Returns how the current frame was decoded.
  virtual DecodedBy decoded_by() const = 0;
};

}  // namespace stgs::encoder
