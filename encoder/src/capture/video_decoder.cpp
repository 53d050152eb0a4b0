// SPDX-License-Identifier: Apache-2.0
#include "video_decoder.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>

#include "stgs/encoder/image_file.h"
#include "stgs/format/parallel.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <libavutil/opt.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
}

namespace stgs::encoder {
namespace {

// While FFmpeg opens a file, it decodes only these codecs. The frames that it decodes later have
// been checked before.
constexpr const char* kProbedCodecs =
    "h264,hevc,av1,libdav1d,libaom-av1,vp8,vp9,mpeg4,mpeg2video,prores,dnxhd,cfhd,ffv1,rawvideo,"
    "aac,mp3,ac3,opus,vorbis,pcm_s16le,pcm_s16be,pcm_s24le";

template <typename T, void (*kFree)(T**)>
struct Freed {
  void operator()(T* object) const { kFree(&object); }
};
using Format = std::unique_ptr<AVFormatContext, Freed<AVFormatContext, avformat_close_input>>;
using Codec = std::unique_ptr<AVCodecContext, Freed<AVCodecContext, avcodec_free_context>>;
using Packet = std::unique_ptr<AVPacket, Freed<AVPacket, av_packet_free>>;
using Frame = std::unique_ptr<AVFrame, Freed<AVFrame, av_frame_free>>;
struct FreeScaler {
  void operator()(SwsContext* scaler) const { sws_freeContext(scaler); }
};
using Scaler = std::unique_ptr<SwsContext, FreeScaler>;

Status no_memory() {
  return {StatusCode::kNoMemory, "not enough memory"};
}

Status failure(int error) {
  if (error == AVERROR(ENOMEM)) return no_memory();
  char text[AV_ERROR_MAX_STRING_SIZE];
  std::string reason = av_make_error_string(text, sizeof text, error);
  for (const int of_system : {EAGAIN, EMFILE, ENFILE}) {
    if (error == AVERROR(of_system)) return {StatusCode::kIo, std::move(reason)};
  }
  return {StatusCode::kInvalidFile, std::move(reason)};
}

// The form of frames on which their conversion depends.
struct Form {
  int width = 0, height = 0;
  AVPixelFormat pixels = AV_PIX_FMT_NONE;
  AVColorSpace matrix = AVCOL_SPC_UNSPECIFIED;
  AVChromaLocation chroma = AVCHROMA_LOC_UNSPECIFIED;
  bool full_range = false;
  bool operator==(const Form&) const = default;
};

// Formats that imply the full range.
bool has_full_range(AVPixelFormat format) {
  switch (format) {
    case AV_PIX_FMT_YUVJ411P:
    case AV_PIX_FMT_YUVJ420P:
    case AV_PIX_FMT_YUVJ422P:
    case AV_PIX_FMT_YUVJ440P:
    case AV_PIX_FMT_YUVJ444P:
      return true;
    default:
      return false;
  }
}

Form form_of(const AVFrame& frame) {
  Form form;
  form.width = frame.width;
  form.height = frame.height;
  form.pixels = static_cast<AVPixelFormat>(frame.format);
  form.matrix = frame.colorspace;
  if (form.matrix == AVCOL_SPC_UNSPECIFIED || form.matrix == AVCOL_SPC_RGB)
    form.matrix = frame.width >= 1280 || frame.height > 576 ? AVCOL_SPC_BT709 : AVCOL_SPC_SMPTE170M;
  form.full_range = frame.color_range == AVCOL_RANGE_JPEG || has_full_range(form.pixels);
  form.chroma = frame.chroma_location;
  if (form.chroma == AVCHROMA_LOC_UNSPECIFIED)
    form.chroma = has_full_range(form.pixels) ? AVCHROMA_LOC_CENTER : AVCHROMA_LOC_LEFT;
  return form;
}

// Makes a converter to BGR of the same size.
Result<Scaler> make_scaler(const Form& form) {
  Scaler scaler(sws_alloc_context());
  if (scaler == nullptr) return no_memory();
  const auto set = [&](const char* option, std::int64_t value) {
    av_opt_set_int(scaler.get(), option, value, 0);
  };
  set("srcw", form.width);
  set("srch", form.height);
  set("src_format", form.pixels);
  set("dstw", form.width);
  set("dsth", form.height);
  set("dst_format", AV_PIX_FMT_BGR24);
  // Without the last three, swscale repeats each chroma value for all of its pixels.
  set("sws_flags", SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP | SWS_FULL_CHR_H_INT);
  // The position of a chroma sample from its first pixel, in 1/256 pixels.
  const AVPixFmtDescriptor* const layout = av_pix_fmt_desc_get(form.pixels);
  const AVChromaLocation c = form.chroma;
  if (layout != nullptr && layout->log2_chroma_w > 0)
    set("src_h_chr_pos",
        c == AVCHROMA_LOC_CENTER || c == AVCHROMA_LOC_TOP || c == AVCHROMA_LOC_BOTTOM ? 128 : 0);
  if (layout != nullptr && layout->log2_chroma_h > 0)
    set("src_v_chr_pos", c == AVCHROMA_LOC_TOPLEFT || c == AVCHROMA_LOC_TOP         ? 0
                         : c == AVCHROMA_LOC_BOTTOMLEFT || c == AVCHROMA_LOC_BOTTOM ? 256
                                                                                    : 128);
  // It fails for RGB, which has no matrix.
  sws_setColorspaceDetails(scaler.get(), sws_getCoefficients(form.matrix), form.full_range,
                           sws_getCoefficients(SWS_CS_DEFAULT), 1, 0, 1 << 16, 1 << 16);
  const int error = sws_init_context(scaler.get(), nullptr, nullptr);
  if (error < 0) return failure(error);
  return scaler;
}

// Returns the clockwise rotation that the file states, as a code of cv::rotate(); -1: none.
int rotation_of(const AVStream& stream) {
#if LIBAVCODEC_VERSION_INT >= AV_VERSION_INT(60, 31, 100)
  const AVPacketSideData* const side =
      av_packet_side_data_get(stream.codecpar->coded_side_data, stream.codecpar->nb_coded_side_data,
                              AV_PKT_DATA_DISPLAYMATRIX);
  const std::uint8_t* const data = side == nullptr ? nullptr : side->data;
  const std::size_t bytes = side == nullptr ? 0 : side->size;
#else
  std::size_t bytes = 0;
  const std::uint8_t* const data =
      av_stream_get_side_data(&stream, AV_PKT_DATA_DISPLAYMATRIX, &bytes);
#endif
  if (data == nullptr || bytes < 9 * sizeof(std::int32_t)) return -1;
  const double angle = av_display_rotation_get(reinterpret_cast<const std::int32_t*>(data));
  if (!std::isfinite(angle)) return -1;
  switch (static_cast<int>(std::lround(-angle / 90)) & 3) {  // FFmpeg's is counter-clockwise
    case 1:
      return cv::ROTATE_90_CLOCKWISE;
    case 2:
      return cv::ROTATE_180;
    case 3:
      return cv::ROTATE_90_COUNTERCLOCKWISE;
    default:
      return -1;
  }
}

class FfmpegDecoder final : public VideoDecoder {
 public:
  FfmpegDecoder(const std::string& label, CheckStored check)
      : label_(label), check_(std::move(check)) {}

  Status open(const std::string& name);
  const VideoTrack& track() const override { return track_; }
  Result<bool> advance() override;
  Result<cv::Mat> image() override;

 private:
  Status open_format(const std::string& name);
  Status open_codec();
  void describe();
  // Gives the decoder the next stored frame; after the last, ends its input.
  Status send();
  // Adds the frame to an error.
  Status explained(const Status& status) const;

  std::string label_;
  CheckStored check_;
  Format format_;
  Codec codec_;
  Packet packet_;
  Frame decoded_;
  Scaler scaler_;
  Form form_;  // of scaler_
  VideoTrack track_;
  AVStream* stream_ = nullptr;  // of format_
  int rotation_ = -1;
  int frame_ = -1;  // number of the current one
  bool ended_ = false;
};

Status FfmpegDecoder::open(const std::string& name) {
  Status status = open_format(name);
  if (status.ok()) status = open_codec();
  if (!status.ok()) {
    return {status.code(),
            fmt::format("{}: cannot be opened ({}); check that ffmpeg plays it and that /proc is "
                        "mounted",
                        label_, status.message())};
  }
  describe();
  packet_.reset(av_packet_alloc());
  decoded_.reset(av_frame_alloc());
  return packet_ == nullptr || decoded_ == nullptr ? no_memory() : Status();
}

Status FfmpegDecoder::explained(const Status& status) const {
  return {status.code(),
          fmt::format("{}: cannot decode frame {} ({}); if it is damaged, copy the file again or "
                      "select other frames with --frames",
                      label_, frame_ + 1, status.message())};
}

Status FfmpegDecoder::open_format(const std::string& name) {
  AVDictionary* options = nullptr;
  av_dict_set(&options, "protocol_whitelist", "file", 0);
  av_dict_set(&options, "format_whitelist", "mov,mp4,matroska,webm,avi", 0);
  av_dict_set(&options, "codec_whitelist", kProbedCodecs, 0);
  av_dict_set(&options, "ignore_chapters", "1", 0);
  AVFormatContext* opened = nullptr;
  int error = avformat_open_input(&opened, name.c_str(), nullptr, &options);
  av_dict_free(&options);
  if (error < 0) return failure(error);
  format_.reset(opened);
  error = avformat_find_stream_info(opened, nullptr);
  if (error < 0) return failure(error);
  return {};
}

Status FfmpegDecoder::open_codec() {
  const int index = av_find_best_stream(format_.get(), AVMEDIA_TYPE_VIDEO, -1, -1, nullptr, 0);
  if (index < 0) return {StatusCode::kInvalidFile, "it has no video track"};
  for (unsigned i = 0; i < format_->nb_streams; ++i) {
    if (static_cast<int>(i) != index) format_->streams[i]->discard = AVDISCARD_ALL;
  }
  stream_ = format_->streams[index];
  const AVCodec* const codec = avcodec_find_decoder(stream_->codecpar->codec_id);
  if (codec == nullptr) {
    return {StatusCode::kInvalidFile, fmt::format("its codec, {}, is missing from FFmpeg",
                                                  avcodec_get_name(stream_->codecpar->codec_id))};
  }
  codec_.reset(avcodec_alloc_context3(codec));
  if (codec_ == nullptr) return no_memory();
  int error = avcodec_parameters_to_context(codec_.get(), stream_->codecpar);
  if (error < 0) return failure(error);
  codec_->thread_count = concurrency();
  codec_->max_pixels = kMaxImagePixels;
  error = avcodec_open2(codec_.get(), codec, nullptr);
  return error < 0 ? failure(error) : Status();
}

void FfmpegDecoder::describe() {
  track_.width = stream_->codecpar->width;
  track_.height = stream_->codecpar->height;
  rotation_ = rotation_of(*stream_);
  AVRational rate = av_guess_frame_rate(format_.get(), stream_, nullptr);
  if (rate.num <= 0 || rate.den <= 0) rate = stream_->avg_frame_rate;
  if (rate.num > 0 && rate.den > 0) track_.fps = av_q2d(rate);
  track_.frames = stream_->nb_frames;
  if (track_.frames > 0 || track_.fps <= 0) return;
  const double seconds = format_->duration > 0
                             ? static_cast<double>(format_->duration) / AV_TIME_BASE
                             : static_cast<double>(stream_->duration) * av_q2d(stream_->time_base);
  const double frames = std::floor(seconds * track_.fps + 0.5);
  track_.frames = frames > 0 ? static_cast<std::int64_t>(std::min(frames, 1e15)) : 0;
}

Status FfmpegDecoder::send() {
  while (!ended_) {
    int error = av_read_frame(format_.get(), packet_.get());
    if (error == AVERROR(ENOMEM)) return explained(failure(error));
    ended_ = error < 0;  // at the end, or where the file is truncated
    if (ended_) break;
    const std::span<const std::uint8_t> stored(packet_->data,
                                               static_cast<std::size_t>(packet_->size));
    const bool is_video = packet_->stream_index == stream_->index && packet_->size > 0;
    Status status = is_video ? check_(stored) : Status();
    if (status.ok() && is_video && (packet_->flags & AV_PKT_FLAG_CORRUPT) != 0)
      status = explained({StatusCode::kInvalidFile, "cut short"});
    if (is_video && status.ok()) {
      error = avcodec_send_packet(codec_.get(), packet_.get());
      if (error < 0) status = explained(failure(error));
    }
    av_packet_unref(packet_.get());
    if (is_video || !status.ok()) return status;
  }
  const int error = avcodec_send_packet(codec_.get(), nullptr);
  return error < 0 && error != AVERROR_EOF ? explained(failure(error)) : Status();
}

Result<bool> FfmpegDecoder::advance() {
  while (true) {
    const int error = avcodec_receive_frame(codec_.get(), decoded_.get());
    if (error >= 0) {
      ++frame_;
      return true;
    }
    if (error == AVERROR_EOF) return false;
    if (error != AVERROR(EAGAIN)) return explained(failure(error));
    STGS_TRY(send());
  }
}

Result<cv::Mat> FfmpegDecoder::image() {
  const Form form = form_of(*decoded_);
  STGS_TRY(check_image_size(form.width, form.height, label_));
  if (scaler_ == nullptr || !(form == form_)) {
    Result<Scaler> scaler = make_scaler(form);
    if (!scaler.ok()) return explained(scaler.status());
    scaler_ = std::move(*scaler);
    form_ = form;
  }
  cv::Mat image(form.height, form.width, CV_8UC3);
  std::uint8_t* planes[4] = {image.data};
  const int strides[4] = {static_cast<int>(image.step)};
  const int error =
      sws_scale(scaler_.get(), decoded_->data, decoded_->linesize, 0, form.height, planes, strides);
  if (error < 0) return explained(failure(error));
  if (rotation_ >= 0) cv::rotate(image, image, rotation_);
  return image;
}

}  // namespace

Result<std::unique_ptr<VideoDecoder>> VideoDecoder::open(const std::string& name,
                                                         const std::string& label,
                                                         CheckStored check) {
  auto decoder = std::make_unique<FfmpegDecoder>(label, std::move(check));
  STGS_TRY(decoder->open(name));
  return std::unique_ptr<VideoDecoder>(std::move(decoder));
}

}  // namespace stgs::encoder
