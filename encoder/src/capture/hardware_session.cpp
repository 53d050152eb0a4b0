// SPDX-License-Identifier: Apache-2.0
#include "hardware_session.h"

#include <algorithm>
#include <array>

#include "frame_converter.h"
#include "h264_parameters.h"

extern "C" {
#include <libavutil/hwcontext.h>
#include <libavutil/pixdesc.h>
}

namespace stgs::encoder {
namespace {

constexpr std::array kCodecs = {AV_CODEC_ID_H264, AV_CODEC_ID_HEVC, AV_CODEC_ID_VP9,
                                AV_CODEC_ID_AV1};
// FFmpeg's decoder of AV1 that uses hardware. Its default decoder does not.
constexpr const char* kHardwareAv1 = "av1";
// FFmpeg adds this number of surfaces to those that the stream needs.
constexpr int kWorkSurfaces = 4;

bool is_hardware(AVPixelFormat format) {
  const AVPixFmtDescriptor* const layout = av_pix_fmt_desc_get(format);
  return layout != nullptr && (layout->flags & AV_PIX_FMT_FLAG_HWACCEL) != 0;
}

// The formats of which the decoded pixels are the same on the GPU.
bool is_exact(AVPixelFormat format) {
  return format == AV_PIX_FMT_YUV420P || format == AV_PIX_FMT_YUVJ420P ||
         format == AV_PIX_FMT_YUV420P10;
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

const AVCodec* HardwareSession::find_decoder(AVCodecID id) {
  only_hardware_ = false;
  const bool is_known = std::find(kCodecs.begin(), kCodecs.end(), id) != kCodecs.end();
  if (decoding_.device && !is_known)
    refuse(fmt::format("NVDEC does not decode {}", avcodec_get_name(id)));
  if (decoding_.device && refusal_.empty() && id == AV_CODEC_ID_AV1) {
    const AVCodec* const decoder = avcodec_find_decoder_by_name(kHardwareAv1);
    only_hardware_ = decoder != nullptr;
    if (only_hardware_) return decoder;
    refuse("this build of FFmpeg decodes AV1 on the CPU alone");
  }
  return avcodec_find_decoder(id);
}

Status HardwareSession::attach(AVCodecContext& codec) {
  if (!decoding_.device || !refusal_.empty()) return {};
  codec.hw_device_ctx = av_buffer_ref(decoding_.device->context());
  if (codec.hw_device_ctx == nullptr) return ffmpeg_error(AVERROR(ENOMEM));
  codec.opaque = this;
  codec.get_format = [](AVCodecContext* asking, const AVPixelFormat* offered) {
    return static_cast<HardwareSession*>(asking->opaque)->choose(*asking, offered);
  };
  return {};
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
  if (!is_exact(codec.sw_pix_fmt) || (!has_gpu && !offered_)) {
    return fmt::format("NVDEC does not decode {} as {}", avcodec_get_name(codec.codec_id),
                       format == nullptr ? "an unknown format" : format);
  }
  // Of these, the chroma would differ.
  if (codec.width % 2 != 0 || codec.height % 2 != 0) {
    return fmt::format("NVDEC does not decode {} of {}x{} pixels, an odd size",
                       avcodec_get_name(codec.codec_id), codec.width, codec.height);
  }
  // Of these, FFmpeg leaves the chroma of frames in GPU memory undefined.
  const auto bytes = static_cast<std::size_t>(std::max(codec.extradata_size, 0));
  if (codec.codec_id == AV_CODEC_ID_H264 && is_grey_h264({codec.extradata, bytes}))
    return "NVDEC does not decode h264 without colour";
  // FFmpeg asks again without the GPU if that has failed.
  offered_ = has_gpu;
  if (has_gpu) return reserve(codec);
  return fmt::format("the GPU does not decode {} of {}x{} pixels as {}",
                     avcodec_get_name(codec.codec_id), codec.coded_width, codec.coded_height,
                     format);
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
