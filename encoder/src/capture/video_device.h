// SPDX-License-Identifier: Apache-2.0
// The video decoder of an NVIDIA GPU (NVDEC), which FFmpeg's decoders of H.264, HEVC and VP9 can
// use.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <string>

#include "ffmpeg_types.h"
#include "stgs/encoder/prepare.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Thread-safe.
class VideoDevice {
 public:
  // Opens GPU number `gpu` modulo the number of GPUs, in the CUDA context of the kernels. kNotBuilt
  // without CUDA, kUnsupported without a GPU or the decoder library of its driver.
  static Result<std::shared_ptr<VideoDevice>> open(int gpu);

  const std::string& name() const { return name_; }
  // Returns FFmpeg's device context, which decoders share.
  AVBufferRef* context() const { return context_.get(); }

  // Reserves memory for the surfaces of a decoder, and returns whether it is available. All
  // decoders together may use a quarter of the memory that was free when the device was opened.
  bool reserve(std::size_t bytes);
  void release(std::size_t bytes);

 private:
  VideoDevice(std::string name, ffmpeg::Buffer context, std::size_t free_bytes)
      : name_(std::move(name)), context_(std::move(context)), limit_(free_bytes / 4) {}

  const std::string name_;
  const ffmpeg::Buffer context_;
  const std::size_t limit_;
  std::mutex mutex_;
  std::size_t used_ = 0;
};

// How videos are decoded.
struct VideoDecoding {
  std::shared_ptr<VideoDevice> device;  // null: all on the CPU
  // Videos that the device cannot decode are an error, kUnsupported. Otherwise the CPU decodes
  // them.
  bool required = false;
};

inline constexpr std::int64_t kEndless = std::numeric_limits<std::int64_t>::max();

// Follows settings.video_decoder: "cpu", "cuda", or "auto". That is the GPU if it can be used,
// settings.backend is not "cpu", and the videos are worth the start of decoders: `pixels`, in all
// frames that are decoded of the longest, are more than the cores decode meanwhile. Errors of
// VideoDevice::open() for "cuda" alone; for "auto" they are logged.
Result<VideoDecoding> choose_video_decoding(const PrepareSettings& settings, std::int64_t pixels,
                                            const LogSink& log);

}  // namespace stgs::encoder
