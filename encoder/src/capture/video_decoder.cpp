// SPDX-License-Identifier: Apache-2.0
#include "video_decoder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "decode_start.h"
#include "frame_converter.h"
#include "gpu_frame.h"
#include "hardware_session.h"
#include "stgs/encoder/image_file.h"
#include "video_input.h"
#include "video_rotation.h"

extern "C" {
#include <libavutil/mem.h>
}

namespace stgs::encoder {
namespace {

constexpr int kMaxDamaged = 250;  // packets in a row that a stream may lose
constexpr std::size_t kMaxPacketBytes = std::size_t{64} << 20;

class FfmpegDecoder final : public VideoDecoder {
 public:
  FfmpegDecoder(const std::string& label, CheckStored check, VideoDecoding decoding)
      : label_(label), check_(std::move(check)), hardware_(std::move(decoding)) {}

  // `stopped`: of a stream; empty for a file.
  Status open(const std::string& name, std::function<bool()> stopped = {});
  const VideoTrack& track() const override { return track_; }
  double seconds() const override;
  Result<bool> skip_to(int first) override;
  Result<bool> advance() override;
  cv::Size size() const override;
  Result<cv::Mat> image() override;
  std::optional<geometry::YuvFrame> yuv() override;
  DecodedBy decoded_by() const override;

 private:
  Status open_track();
  Status open_codec();
  void describe();
  // Returns whether decoding can start with a key frame, and a stored frame is one frame.
  bool has_independent_frames() const;
  // skip_to() without the name of the video in errors.
  Result<bool> try_to_skip(int first);
  // Reads the next stored frame into packet_. Returns false at the end.
  Result<bool> read_stored();
  Result<std::vector<StoredFrame>> list_stored(std::size_t frames);
  // Sends the next stored frame to the decoder; after the last, signals the end.
  Status send();
  // Checks packet_ and sends it to the decoder.
  Status send_packet();
  Status check_size() const;
  // Returns the current frame as BGR, before rotation. Throws cv::Exception.
  Result<cv::Mat> converted();
  // Returns the pixel format of the current frame on the CPU.
  AVPixelFormat stated_format() const;
  // Adds the file, the frame and a remedy to an error.
  Status explained(const Status& status) const;

  std::string label_;
  CheckStored check_;
  std::function<bool()> stopped_;  // outlives format_, which calls it
  VideoInput format_;
  HardwareSession hardware_;  // outlives codec_, which calls it
  ffmpeg::Codec codec_;
  ffmpeg::Packet packet_;
  ffmpeg::Frame decoded_;
  ffmpeg::Frame copied_;  // of a frame in GPU memory
  FrameConverter converter_;
  VideoTrack track_;
  AVStream* stream_ = nullptr;  // of format_
  int rotation_ = -1;
  int frame_ = -1;              // number of the current one
  int width_ = 0, height_ = 0;  // of the first decoded frame
  bool ended_ = false;
  int damaged_ = 0;  // packets in a row, of a stream
  Status error_;     // after the frames that are still in the decoder
};

Status FfmpegDecoder::open(const std::string& name, std::function<bool()> stopped) {
  stopped_ = std::move(stopped);
  Status status = stopped_ ? format_.open_stream(name, stopped_) : format_.open_file(name);
  if (status.ok()) status = open_track();
  if (stopped_ && stopped_()) return runtime_error("{}: stopped", label_);
  if (status.code() == StatusCode::kInvalidFile && !stopped_) {
    return {status.code(), fmt::format("{}: cannot be opened ({}); check that ffmpeg plays it, and "
                                       "that /proc is mounted",
                                       label_, status.message())};
  }
  if (status.ok()) {
    describe();
    packet_.reset(av_packet_alloc());
    decoded_.reset(av_frame_alloc());
    copied_.reset(av_frame_alloc());
    if (!packet_ || !decoded_ || !copied_) status = ffmpeg_error(AVERROR(ENOMEM));
  }
  if (status.ok()) return {};
  return {status.code(), fmt::format("{}: cannot be opened ({})", label_, status.message())};
}

Status FfmpegDecoder::explained(const Status& status) const {
  std::string remedy;
  if (status.code() == StatusCode::kInvalidFile && !stopped_)
    remedy = frame_ < 0 ? "; copy or encode the video again"
                        : "; copy or encode the video again, or select the frames before with "
                          "--frames";
  // The GPU may have failed.
  if (hardware_.is_active()) remedy = "; try --video-decoder cpu" + remedy;
  return {status.code(), fmt::format("{}: cannot decode frame {} ({}){}", label_, frame_ + 1,
                                     status.message(), remedy)};
}

DecodedBy FfmpegDecoder::decoded_by() const {
  return {decoded_->format == AV_PIX_FMT_CUDA, hardware_.refusal()};
}

double FfmpegDecoder::seconds() const {
  const std::int64_t time = decoded_->best_effort_timestamp;
  return time == AV_NOPTS_VALUE ? std::numeric_limits<double>::quiet_NaN()
                                : static_cast<double>(time) * av_q2d(stream_->time_base);
}

Status FfmpegDecoder::open_track() {
  // The first video track. Others are previews or further lenses.
  for (unsigned i = 0; i < format_->nb_streams; ++i) {
    AVStream* const stream = format_->streams[i];
    stream->discard = AVDISCARD_ALL;
    const bool is_video = stream->codecpar->codec_type == AVMEDIA_TYPE_VIDEO &&
                          (stream->disposition & AV_DISPOSITION_ATTACHED_PIC) == 0;
    if (is_video && stream_ == nullptr) stream_ = stream;
  }
  if (stream_ == nullptr) return {StatusCode::kInvalidFile, "it has no video track"};
  stream_->discard = AVDISCARD_DEFAULT;
  return open_codec();
}

Status FfmpegDecoder::open_codec() {
  const AVCodec* const codec = avcodec_find_decoder(stream_->codecpar->codec_id);
  if (codec == nullptr) {
    return unsupported("its codec, {}, is missing from FFmpeg; convert the video to H.264",
                       avcodec_get_name(stream_->codecpar->codec_id));
  }
  codec_.reset(avcodec_alloc_context3(codec));
  if (codec_ == nullptr) return ffmpeg_error(AVERROR(ENOMEM));
  int error = avcodec_parameters_to_context(codec_.get(), stream_->codecpar);
  if (error < 0) return ffmpeg_error(error);
  STGS_TRY(hardware_.attach(*codec_));
  // The cameras of a rig are decoded in parallel. With threads for frames, too, memory would grow
  // with their product, and an error would be found at a frame that depends on their number.
  codec_->thread_count = 1;
  if (stopped_) {
    codec_->flags |= AV_CODEC_FLAG_LOW_DELAY;
    codec_->codec_whitelist = av_strdup(kStreamCodecs);
  }
  codec_->max_pixels = kMaxImagePixels;
  error = avcodec_open2(codec_.get(), codec, nullptr);
  return error < 0 ? ffmpeg_error(error) : Status();
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

Status FfmpegDecoder::send_packet() {
  if (stopped_ && (packet_->flags & AV_PKT_FLAG_CORRUPT) != 0) return {};
  STGS_TRY(check_({packet_->data, static_cast<std::size_t>(packet_->size)}));
  if ((packet_->flags & AV_PKT_FLAG_CORRUPT) != 0) return invalid_file("cut short");
  hardware_.inspect(*codec_, *packet_);
  const int error = avcodec_send_packet(codec_.get(), packet_.get());
  STGS_TRY(hardware_.check());
  if (error == AVERROR_INVALIDDATA && stopped_ && ++damaged_ < kMaxDamaged) return {};
  return error < 0 ? ffmpeg_error(error) : Status();
}

Result<bool> FfmpegDecoder::read_stored() {
  while (true) {
    av_packet_unref(packet_.get());
    const int error = av_read_frame(format_.get(), packet_.get());
    if (error == AVERROR(ENOMEM) || error == AVERROR(EIO)) return ffmpeg_error(error);
    if (error < 0) return false;  // at the end, or where the file is truncated
    if (packet_->stream_index == stream_->index && packet_->size > 0) return true;
  }
}

Status FfmpegDecoder::send() {
  if (!ended_) {
    STGS_ASSIGN(const bool has_packet, read_stored());
    if (has_packet) {
      Status status = send_packet();
      av_packet_unref(packet_.get());
      return status;
    }
    ended_ = true;
  }
  const int error = avcodec_send_packet(codec_.get(), nullptr);
  return error < 0 && error != AVERROR_EOF ? ffmpeg_error(error) : Status();
}

bool FfmpegDecoder::has_independent_frames() const {
  const AVCodecParameters& track = *stream_->codecpar;
  const AVCodecDescriptor* const codec = avcodec_descriptor_get(track.codec_id);
  const bool intra_only = codec != nullptr && (codec->props & AV_CODEC_PROP_INTRA_ONLY) != 0;
  const bool progressive =
      track.field_order == AV_FIELD_PROGRESSIVE || track.field_order == AV_FIELD_UNKNOWN;
  return progressive &&
         (intra_only || track.codec_id == AV_CODEC_ID_H264 || track.codec_id == AV_CODEC_ID_HEVC);
}

// Returns fewer frames at the end of the file, and none if a time is not stated or a frame is not
// shown.
Result<std::vector<StoredFrame>> FfmpegDecoder::list_stored(std::size_t frames) {
  std::vector<StoredFrame> out;
  while (out.size() < frames) {
    STGS_ASSIGN(const bool has_packet, read_stored());
    if (!has_packet) break;
    STGS_TRY(check_({packet_->data, static_cast<std::size_t>(packet_->size)}));
    if (packet_->pts == AV_NOPTS_VALUE || (packet_->flags & AV_PKT_FLAG_DISCARD) != 0)
      return std::vector<StoredFrame>();
    out.push_back({packet_->pts, (packet_->flags & AV_PKT_FLAG_KEY) != 0});
  }
  return out;
}

Result<bool> FfmpegDecoder::skip_to(int first) {
  Result<bool> skipped = try_to_skip(first);
  return skipped.ok() ? skipped : explained(skipped.status());
}

Result<bool> FfmpegDecoder::try_to_skip(int first) {
  const auto count = static_cast<std::size_t>(first);
  if (!has_independent_frames()) return false;
  STGS_ASSIGN(std::vector<StoredFrame> stored, list_stored(count + kMaxReordered));
  const std::size_t start = stored.size() > count ? decode_start(stored, count - 1) : 0;
  if (start == 0) return false;
  const std::int64_t start_time = stored[start].time;
  if (av_seek_frame(format_.get(), stream_->index, start_time, AVSEEK_FLAG_BACKWARD) < 0)
    return false;
  do {  // seeking may lead to an earlier frame
    STGS_ASSIGN(const bool has_packet, read_stored());
    if (!has_packet || packet_->pts > start_time) return false;
  } while (packet_->pts != start_time);
  if (!send_packet().ok()) return false;
  frame_ = static_cast<int>(start) - 1;
  while (frame_ + 1 < first) {
    const Result<bool> advanced = advance();
    if (!advanced.ok() || !*advanced) return false;
    // Decoding does not start at once if the frame refreshes only a part of the image.
    const bool is_start = frame_ == static_cast<int>(start);
    if (is_start &&
        (decoded_->best_effort_timestamp != start_time || decoded_->pict_type != AV_PICTURE_TYPE_I))
      return false;
  }
  const auto last = stored.begin() + (first - 1);
  std::nth_element(stored.begin(), last, stored.end(),
                   [](const auto& a, const auto& b) { return a.time < b.time; });
  return decoded_->best_effort_timestamp == last->time;
}

Status FfmpegDecoder::check_size() const {
  if (decoded_->width == width_ && decoded_->height == height_) return {};
  return invalid_file(
      "{}: frame {} differs in size from the frames before it (expected {}x{}, got "
      "{}x{})",
      label_, frame_, width_, height_, decoded_->width, decoded_->height);
}

Result<bool> FfmpegDecoder::advance() {
  while (true) {
    const int received = avcodec_receive_frame(codec_.get(), decoded_.get());
    if (received >= 0) break;
    if (received == AVERROR_INVALIDDATA && stopped_ && ++damaged_ < kMaxDamaged) continue;
    if (received == AVERROR_EOF && error_.ok()) return false;
    if (!error_.ok()) return explained(error_);
    Status status = received == AVERROR(EAGAIN) ? send() : ffmpeg_error(received);
    if (status.ok()) continue;
    // First the frames that were complete before the error.
    error_ = std::move(status);
    ended_ = true;
    avcodec_send_packet(codec_.get(), nullptr);
  }
  ++frame_;
  damaged_ = 0;
  if (decoded_->format == AV_PIX_FMT_CUDA) align_gpu_crop(*decoded_, stated_format());
  if (width_ == 0) {
    width_ = decoded_->width;
    height_ = decoded_->height;
    STGS_TRY(check_image_size(width_, height_, label_));
  }
  STGS_TRY(check_size());
  return true;
}

cv::Size FfmpegDecoder::size() const {
  cv::Size size(decoded_->width, decoded_->height);
  if (decoded_->format == AV_PIX_FMT_CUDA) {
    size.width -= static_cast<int>(decoded_->crop_left);
    size.height -= static_cast<int>(decoded_->crop_top);
  }
  const bool is_turned =
      rotation_ == cv::ROTATE_90_CLOCKWISE || rotation_ == cv::ROTATE_90_COUNTERCLOCKWISE;
  return is_turned ? cv::Size(size.height, size.width) : size;
}

AVPixelFormat FfmpegDecoder::stated_format() const {
  return decoded_->format == AV_PIX_FMT_CUDA ? format_of_gpu_frame(*decoded_, codec_->sw_pix_fmt)
                                             : static_cast<AVPixelFormat>(decoded_->format);
}

std::optional<geometry::YuvFrame> FfmpegDecoder::yuv() {
  geometry::YuvFrame out;
  out.rule = converter_.gpu_rule(*decoded_, stated_format());
  if (!out.rule || !set_planes(*decoded_, stated_format(), out)) return std::nullopt;
  out.quarters = rotation_ + 1;
  return out;
}

Result<cv::Mat> FfmpegDecoder::converted() {
  if (decoded_->format != AV_PIX_FMT_CUDA) return converter_.convert(*decoded_, stated_format());
  STGS_TRY(copy_from_gpu(*decoded_, *copied_));
  return converter_.convert(*copied_, stated_format());
}

Result<cv::Mat> FfmpegDecoder::image() {
  Result<cv::Mat> image = Status(StatusCode::kNoMemory, "not enough memory");
  try {
    image = converted();
    if (image.ok() && rotation_ >= 0) cv::rotate(*image, *image, rotation_);
  } catch (const cv::Exception& error) {
    if (error.code != cv::Error::StsNoMem) throw;
  }
  if (image.ok()) return image;
  return Status(image.status().code(), fmt::format("{}: cannot convert frame {} ({})", label_,
                                                   frame_, image.status().message()));
}

}  // namespace

Result<std::unique_ptr<VideoDecoder>> VideoDecoder::open(const std::string& name,
                                                         const std::string& label,
                                                         CheckStored check,
                                                         VideoDecoding decoding) {
  auto decoder = std::make_unique<FfmpegDecoder>(label, std::move(check), std::move(decoding));
  STGS_TRY(decoder->open(name));
  return std::unique_ptr<VideoDecoder>(std::move(decoder));
}

Result<std::unique_ptr<VideoDecoder>> VideoDecoder::open_stream(const std::string& url,
                                                                const std::string& label,
                                                                std::function<bool()> stopped,
                                                                VideoDecoding decoding) {
  const auto check = [](std::span<const std::uint8_t> stored) -> Status {
    if (stored.size() <= kMaxPacketBytes) return {};
    return invalid_file("a frame of {} bytes", stored.size());
  };
  auto decoder = std::make_unique<FfmpegDecoder>(label, check, std::move(decoding));
  STGS_TRY(decoder->open(url, std::move(stopped)));
  return std::unique_ptr<VideoDecoder>(std::move(decoder));
}

}  // namespace stgs::encoder
