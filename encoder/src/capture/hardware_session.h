// SPDX-License-Identifier: Apache-2.0
// The use of a GPU's video decoder by one of FFmpeg's decoders.
#pragma once

#include <string>

#include "video_device.h"

namespace stgs::encoder {

class HardwareSession {
 public:
  explicit HardwareSession(VideoDecoding decoding) : decoding_(std::move(decoding)) {}
  ~HardwareSession() { release(); }
  HardwareSession(const HardwareSession&) = delete;
  HardwareSession& operator=(const HardwareSession&) = delete;

  // Makes a decoder use the GPU if that decodes its codec. Call it before avcodec_open2().
  Status attach(AVCodecContext& codec);
  // Inspects a packet that the decoder gets next.
  void inspect(const AVCodecContext& codec, const AVPacket& packet);

  // Returns why the CPU decodes the video; "" if the GPU does, or was not asked for. It is final
  // with the first decoded frame.
  const std::string& refusal() const { return refusal_; }
  // Returns the error if the GPU refused, but is required.
  Status check() const;
  // Returns whether the GPU decodes.
  bool is_active() const { return reserved_ > 0; }

 private:
  // Chooses among the formats that FFmpeg's decoder offers; AV_PIX_FMT_NONE is an error.
  AVPixelFormat choose(AVCodecContext& codec, const AVPixelFormat* offered);
  // Returns why the GPU cannot decode the stream; "" if it can.
  std::string find_refusal(AVCodecContext& codec, const AVPixelFormat* offered);
  std::string reserve(AVCodecContext& codec);
  void refuse(std::string reason);
  void release();

  const VideoDecoding decoding_;
  bool is_grey_ = false;      // a packet states H.264 without chroma
  bool offered_ = false;      // FFmpeg has offered the GPU before
  std::size_t reserved_ = 0;  // bytes of device memory
  std::string refusal_;
};

}  // namespace stgs::encoder
