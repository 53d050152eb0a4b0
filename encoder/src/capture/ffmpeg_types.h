// SPDX-License-Identifier: Apache-2.0
// Owners of FFmpeg's objects.
#pragma once

#include <memory>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/buffer.h>
}

namespace stgs::encoder::ffmpeg {

template <typename T, void (*kFree)(T**)>
struct Freed {
  void operator()(T* object) const { kFree(&object); }
};
using Format = std::unique_ptr<AVFormatContext, Freed<AVFormatContext, avformat_close_input>>;
using Codec = std::unique_ptr<AVCodecContext, Freed<AVCodecContext, avcodec_free_context>>;
using Packet = std::unique_ptr<AVPacket, Freed<AVPacket, av_packet_free>>;
using Frame = std::unique_ptr<AVFrame, Freed<AVFrame, av_frame_free>>;
using Buffer = std::unique_ptr<AVBufferRef, Freed<AVBufferRef, av_buffer_unref>>;

}  // namespace stgs::encoder::ffmpeg
