// SPDX-License-Identifier: Apache-2.0
#include "hardware_session.h"

#include <algorithm>
#include <array>
#include <span>

#include "frame_converter.h"
#include "gpu_frame.h"
#include "h264_parameters.h"

extern "C" {
#include <libavutil/hwcontext.h>
#include <libavutil/pixdesc.h>
}

namespace stgs::encoder {
namespace {

constexpr std::array kCodecs = {AV_CODEC_ID_H264, AV_CODEC_ID_HEVC, AV_CODEC_ID_VP9};
// FFmpeg adds three surfaces to those that the stream needs; one is for its successors.
constexpr int kWorkSurfaces = 4;

bool is_hardware(AVPixelFormat format) {
  const AVPixFmtDescriptor* const layout = av_pix_fmt_desc_get(format);
  return layout != nullptr && (layout->flags & AV_PIX_FMT_FLAG_HWACCEL) != 0;
}

template <typename Test>
AVPixelFormat first_of(const AVPixelFormat* offered, Test test) {
  while (*offered != AV_PIX_FMT_NONE && !test(*offered)) ++offered;
  return *offered;
}

// Returns the memory of the surfaces that `frames` describes: decoded ones, and copies for output.
std::size_t surface_bytes(const AVHWFramesContext& frames) {
  const auto pixels =
      static_cast<std::size_t>(frames.width) * static_cast<std::size_t>(frames.height);
  const auto surfaces = static_cast<std::size_t>(frames.initial_pool_size + kWorkSurfaces);
  const std::size_t sample = frames.sw_format == AV_PIX_FMT_NV12 ? 1 : 2;
  return 2 * surfaces * pixels * sample * 3 / 2;
}

}  // namespace

Status HardwareSession::attach(AVCodecContext& codec) {
  if (!decoding_.device) return {};
  if (std::find(kCodecs.begin(), kCodecs.end(), codec.codec_id) == kCodecs.end()) {
    refuse(fmt::format("{} is decoded by the CPU alone", avcodec_get_name(codec.codec_id)));
    return check();
  }
  codec.hw_device_ctx = av_buffer_ref(decoding_.device->context());
  if (codec.hw_device_ctx == nullptr) return ffmpeg_error(AVERROR(ENOMEM));
  codec.opaque = this;
  codec.get_format = [](AVCodecContext* asking, const AVPixelFormat* offered) {
    return static_cast<HardwareSession*>(asking->opaque)->choose(*asking, offered);
  };
  return {};
}

void HardwareSession::inspect(const AVCodecContext& codec, const AVPacket& packet) {
  if (!decoding_.device || codec.codec_id != AV_CODEC_ID_H264 || !refusal_.empty()) return;
  std::span<const std::uint8_t> parameters(
      codec.extradata, static_cast<std::size_t>(std::max(codec.extradata_size, 0)));
  std::size_t size = 0;
  if (const std::uint8_t* const changed =
          av_packet_get_side_data(&packet, AV_PKT_DATA_NEW_EXTRADATA, &size))
    parameters = {changed, size};
  const std::span packet_bytes(packet.data, static_cast<std::size_t>(packet.size));
  is_grey_ = is_grey_ || is_grey_h264(parameters) || is_grey_h264_packet(parameters, packet_bytes);
}

Status HardwareSession::check() const {
  if (refusal_.empty() || !decoding_.required) return {};
  return unsupported("{}; use --video-decoder auto", refusal_);
}

AVPixelFormat HardwareSession::choose(AVCodecContext& codec, const AVPixelFormat* offered) {
  if (refusal_.empty()) {
    std::string refusal = find_refusal(codec, offered);
    if (refusal.empty()) return AV_PIX_FMT_CUDA;
    refuse(std::move(refusal));
  }
  if (decoding_.required) return AV_PIX_FMT_NONE;
  return first_of(offered, [](AVPixelFormat format) { return !is_hardware(format); });
}

std::string HardwareSession::find_refusal(AVCodecContext& codec, const AVPixelFormat* offered) {
  const char* const format = av_get_pix_fmt_name(codec.sw_pix_fmt);
  const bool has_gpu =
      first_of(offered, [](AVPixelFormat f) { return f == AV_PIX_FMT_CUDA; }) == AV_PIX_FMT_CUDA;
  if (!is_gpu_format(codec.sw_pix_fmt) || (!has_gpu && !offered_)) {
    return fmt::format("NVDEC does not decode {} as {}", avcodec_get_name(codec.codec_id),
                       format == nullptr ? "an unknown format" : format);
  }
  // Of these, the chroma would differ.
  if (codec.width % 2 != 0 || codec.height % 2 != 0) {
    return fmt::format("NVDEC does not decode {} of {}x{} pixels, an odd size",
                       avcodec_get_name(codec.codec_id), codec.width, codec.height);
  }
  // Of these, FFmpeg leaves the chroma of frames in GPU memory undefined.
  if (is_grey_) return "NVDEC does not decode h264 without colour";
  // FFmpeg asks again without the GPU if that has failed.
  offered_ = has_gpu;
  if (has_gpu) return reserve(codec);
  return fmt::format(
      "NVDEC could not start with {} of {}x{} pixels as {}: the GPU does not decode "
      "it, or its memory is full",
      avcodec_get_name(codec.codec_id), codec.width, codec.height, format);
}

std::string HardwareSession::reserve(AVCodecContext& codec) {
  AVBufferRef* described = nullptr;
  const int error =
      avcodec_get_hw_frames_parameters(&codec, codec.hw_device_ctx, AV_PIX_FMT_CUDA, &described);
  if (error < 0) return fmt::format("NVDEC: {}", ffmpeg_error(error).message());
  const ffmpeg::Buffer frames(described);
  const std::size_t bytes = surface_bytes(*reinterpret_cast<AVHWFramesContext*>(described->data));
  release();
  if (!decoding_.device->reserve(bytes))
    return "the decoders need more than a quarter of the free GPU memory";
  reserved_ = bytes;
  return {};
}

void HardwareSession::refuse(std::string reason) {
  release();
  refusal_ = std::move(reason);
}

void HardwareSession::release() {
  if (reserved_ > 0) decoding_.device->release(reserved_);
  reserved_ = 0;
}

}  // namespace stgs::encoder
