// SPDX-License-Identifier: Apache-2.0
// Opens video files and live streams with FFmpeg, restricted to the formats that are supported.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "ffmpeg_types.h"
#include "pipe_input.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Codecs of streams, as FFmpeg's option codec_whitelist.
inline constexpr const char* kStreamCodecs =
    "h264,hevc,av1,libdav1d,vp8,vp9,mpeg4,mpeg2video,mjpeg,rawvideo,aac,mp3,ac3,"
    "opus";

// An open container. Errors are those of ffmpeg_error(), without a path.
class VideoInput {
 public:
  // Opens a file, as VideoDecoder::open().
  Status open_file(const std::string& name);
  // Opens a stream, as VideoDecoder::open_stream(). `stopped` must outlive the object.
  Status open_stream(const std::string& url, std::function<bool()>& stopped);

  AVFormatContext* get() const { return format_.get(); }
  AVFormatContext* operator->() const { return format_.get(); }

 private:
  Status find_streams();

  std::unique_ptr<PipeInput> pipe_;  // outlives format_, which reads it; null: not a pipe
  ffmpeg::Format format_;
};

}  // namespace stgs::encoder
