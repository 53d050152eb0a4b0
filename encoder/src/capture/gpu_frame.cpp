// SPDX-License-Identifier: Apache-2.0
#include "gpu_frame.h"

#include "frame_converter.h"

extern "C" {
#include <libavutil/hwcontext.h>
}

namespace stgs::encoder {
namespace {

bool has_ten_bits(AVPixelFormat stated) {
  return stated == AV_PIX_FMT_YUV420P10;
}

}  // namespace

bool is_gpu_format(AVPixelFormat format) {
  return format == AV_PIX_FMT_YUV420P || format == AV_PIX_FMT_YUVJ420P || has_ten_bits(format);
}

AVPixelFormat format_of_gpu_frame(const AVFrame& frame, AVPixelFormat stated) {
  const auto& frames = *reinterpret_cast<const AVHWFramesContext*>(frame.hw_frames_ctx->data);
  const bool ten = frames.sw_format != AV_PIX_FMT_NV12;
  if (ten == has_ten_bits(stated)) return stated;
  return ten ? AV_PIX_FMT_YUV420P10 : AV_PIX_FMT_YUV420P;
}

// FFmpeg leaves columns that are cropped at the left in place if the rows would not start at a
// multiple of 32 bytes. It crops frames in GPU memory only at the right and the bottom.
void align_gpu_crop(AVFrame& frame, AVPixelFormat stated) {
  const std::size_t columns = has_ten_bits(stated) ? 32 : 64;
  frame.crop_left -= frame.crop_left % columns;
}

Status copy_from_gpu(const AVFrame& from, AVFrame& to) {
  av_frame_unref(&to);
  int error = av_hwframe_transfer_data(&to, &from, 0);
  if (error < 0) {
    return runtime_error("the GPU failed: {}; use --video-decoder cpu",
                         ffmpeg_error(error).message());
  }
  error = av_frame_copy_props(&to, &from);
  if (error >= 0) error = av_frame_apply_cropping(&to, 0);
  return error < 0 ? ffmpeg_error(error) : Status();
}

bool set_planes(const AVFrame& frame, AVPixelFormat stated, geometry::YuvFrame& out) {
  const bool needs_crop = frame.crop_left != 0 || frame.crop_top != 0;
  if (needs_crop || frame.linesize[0] < 0) return false;
  out.on_device = frame.format == AV_PIX_FMT_CUDA;
  geometry::YuvPlanes& planes = out.planes;
  planes.width = frame.width;
  planes.height = frame.height;
  planes.bits = has_ten_bits(stated) ? 10 : 8;
  planes.luma = frame.data[0];
  planes.u = frame.data[1];
  planes.luma_stride = static_cast<std::size_t>(frame.linesize[0]);
  planes.chroma_stride = static_cast<std::size_t>(frame.linesize[1]);
  if (out.on_device) {
    planes.shift = 16 - planes.bits;
    planes.v = frame.data[1] + (planes.bits == 8 ? 1 : 2);
    planes.chroma_step = 2;
  } else {
    planes.v = frame.data[2];
    planes.chroma_step = 1;
  }
  return true;
}

}  // namespace stgs::encoder
