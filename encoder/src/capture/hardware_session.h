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

  // Returns FFmpeg's decoder for a codec: one that uses the GPU if that decodes the codec, else the
  // default. Null if there is none.
  const AVCodec* find_decoder(AVCodecID id);
  // Makes a decoder from find_decoder() use the GPU. Call it before avcodec_open2().
  Status attach(AVCodecContext& codec);

  // Returns why the CPU has to decode the video, "" if it need not (so far): known at last when the
  // first frame was decoded.
  const std::string& refusal() const { return refusal_; }
  // Returns the error if the GPU refused, but is required.
  Status check() const;
  // Returns whether the decoder only works on the GPU, which has refused: another is needed.
  bool needs_other_decoder() const { return !refusal_.empty() && only_hardware_; }

 private:
  // Chooses among the formats that FFmpeg's decoder offers; AV_PIX_FMT_NONE is an error.
  AVPixelFormat choose(AVCodecContext& codec, const AVPixelFormat* offered);
  // Returns why the GPU cannot decode the stream; "" if it can.
  std::string find_refusal(AVCodecContext& codec, const AVPixelFormat* offered);
  std::string reserve(AVCodecContext& codec);
  void refuse(std::string reason);
  void release();

  const VideoDecoding decoding_;
  bool only_hardware_ = false;
  bool offered_ = false;      // FFmpeg has offered the GPU before
  std::size_t reserved_ = 0;  // bytes of device memory
  std::string refusal_;
};

}  // namespace stgs::encoder
