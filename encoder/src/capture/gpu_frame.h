// SPDX-License-Identifier: Apache-2.0
// FFmpeg's frames in GPU memory, as NVDEC decodes them: NV12, or P010 for 10 bits. `stated`: the
// format that the CPU would decode.
#pragma once

#include "ffmpeg_types.h"
#include "geometry/frame_warp.h"

namespace stgs::encoder {

// Returns whether NVDEC decodes a format to the pixels of the CPU.
bool is_gpu_format(AVPixelFormat format);

// Returns the format of a frame in GPU memory on the CPU. `stated`: that of the decoder, which may
// already have changed to that of later frames.
AVPixelFormat format_of_gpu_frame(const AVFrame& frame, AVPixelFormat stated);

// Reduces the columns that are cropped at the left to those that FFmpeg crops from frames in host
// memory.
void align_gpu_crop(AVFrame& frame, AVPixelFormat stated);

// Copies a frame in GPU memory to the host, and crops it. kRuntime if FFmpeg reports that the GPU
// has failed.
Status copy_from_gpu(const AVFrame& from, AVFrame& to);

// Sets the planes of a 4:2:0 frame, which may be in host memory. Returns false if it has yet to be
// cropped, or its rows are upside down.
bool set_planes(const AVFrame& frame, AVPixelFormat stated, geometry::YuvFrame& out);

}  // namespace stgs::encoder
