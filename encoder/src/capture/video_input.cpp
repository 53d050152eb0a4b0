// SPDX-License-Identifier: Apache-2.0
#include "video_input.h"

#include <cerrno>
#include <utility>

#include "frame_converter.h"

namespace stgs::encoder {
namespace {

// While FFmpeg opens a file, it decodes frames of these codecs only, to learn their format. Frames
// of others, such as PNG and JPEG, are checked before they are decoded.
constexpr const char* kProbedCodecs =
    "h264,hevc,av1,libdav1d,libaom-av1,vp8,vp9,mpeg4,mpeg2video,prores,dnxhd,cfhd,ffv1,rawvideo,"
    "aac,mp3,ac3,opus,vorbis,pcm_s16le,pcm_s16be,pcm_s24le";

// The protocols of streams: no file, so that a server cannot name one.
constexpr const char* kStreamProtocols = "udp,rtp,rtsp,tcp,http,https,tls";
constexpr const char* kStreamFormats =
    "mpegts,rtsp,rtp,matroska,webm,mov,mp4,mjpeg,mpjpeg,yuv4mpegpipe,h264,hevc";
constexpr const char* kAnalysedMicroseconds = "300000";  // of a stream, to learn its format
constexpr const char* kSilenceMicroseconds = "5000000";  // after which a connection is given up

// Options of FFmpeg.
class Options {
 public:
  Options() = default;
  ~Options() { av_dict_free(&options_); }
  Options(const Options&) = delete;
  Options& operator=(const Options&) = delete;
  void set(const char* name, const char* value) { av_dict_set(&options_, name, value, 0); }
  AVDictionary** get() { return &options_; }

 private:
  AVDictionary* options_ = nullptr;
};

}  // namespace

Status VideoInput::open_file(const std::string& name) {
  Options options;
  options.set("protocol_whitelist", "file");
  options.set("format_whitelist", "mov,mp4,matroska,webm,avi");
  options.set("codec_whitelist", kProbedCodecs);
  options.set("ignore_chapters", "1");
  AVFormatContext* opened = nullptr;
  const int error = avformat_open_input(&opened, name.c_str(), nullptr, options.get());
  if (error < 0) return ffmpeg_error(error);
  format_.reset(opened);
  return find_streams();
}

Status VideoInput::open_stream(const std::string& url, std::function<bool()>& stopped) {
  AVFormatContext* opened = avformat_alloc_context();
  if (opened == nullptr) return ffmpeg_error(AVERROR(ENOMEM));
  opened->interrupt_callback = {
      [](void* asked) { return (*static_cast<std::function<bool()>*>(asked))() ? 1 : 0; },
      &stopped};
  Options options;
  options.set("protocol_whitelist", kStreamProtocols);
  options.set("format_whitelist", kStreamFormats);
  options.set("codec_whitelist", kStreamCodecs);
  options.set("analyzeduration", kAnalysedMicroseconds);
  options.set("rtsp_flags", "prefer_tcp");
  if (url.find("://") == std::string::npos) {
    Result<std::unique_ptr<PipeInput>> pipe = PipeInput::open(url, stopped);
    if (!pipe.ok()) {
      avformat_free_context(opened);
      return pipe.status();
    }
    pipe_ = std::move(*pipe);
    opened->pb = pipe_->context();
  } else {
    options.set("rw_timeout", kSilenceMicroseconds);
    options.set("overrun_nonfatal", "1");
    if (url.starts_with("rtsp:")) options.set("timeout", kSilenceMicroseconds);
  }
  const int error =
      avformat_open_input(&opened, pipe_ ? nullptr : url.c_str(), nullptr, options.get());
  if (error < 0) return ffmpeg_error(error);  // which has freed the context
  format_.reset(opened);
  return find_streams();
}

Status VideoInput::find_streams() {
  const int error = avformat_find_stream_info(format_.get(), nullptr);
  return error < 0 ? ffmpeg_error(error) : Status();
}

}  // namespace stgs::encoder
