// SPDX-License-Identifier: Apache-2.0
#include "video_device.h"

#include <dlfcn.h>

#include <thread>
#include <utility>

#include "backend/gpu_context.h"
#include "frame_converter.h"

extern "C" {
#include <libavutil/hwcontext.h>
#if STGS_HAS_CUDA
#include <libavutil/hwcontext_cuda.h>
#endif
}

namespace stgs::encoder {
namespace {

// The pixels that a core decodes (H.264) while a decoder of the GPU starts, 64 ms on an H200.
// Decoders start one after the other.
constexpr std::int64_t kPixelsPerStart = std::int64_t{1} << 25;

bool is_worth_start(std::int64_t pixels) {
  return pixels / kPixelsPerStart >= std::int64_t{std::thread::hardware_concurrency()};
}

#if STGS_HAS_CUDA
constexpr const char* kDecoderLibrary = "libnvcuvid.so.1";

// FFmpeg loads the library with each decoder, and reports its absence in its log alone.
Status check_decoder_library() {
  void* const library = ::dlopen(kDecoderLibrary, RTLD_LAZY);
  if (library != nullptr) {
    ::dlclose(library);
    return {};
  }
  return unsupported(
      "{}, the video decoder of the NVIDIA driver, was not found; install it (Debian: "
      "libnvcuvid1), "
      "or add 'video' to NVIDIA_DRIVER_CAPABILITIES of a container",
      kDecoderLibrary);
}

Result<ffmpeg::Buffer> make_context(const GpuContext& gpu) {
  ffmpeg::Buffer context(av_hwdevice_ctx_alloc(AV_HWDEVICE_TYPE_CUDA));
  if (context == nullptr) return unsupported("this build of FFmpeg has no CUDA support");
  auto* const device = reinterpret_cast<AVHWDeviceContext*>(context->data);
  static_cast<AVCUDADeviceContext*>(device->hwctx)->cuda_ctx = static_cast<CUcontext>(gpu.context);
  const int error = av_hwdevice_ctx_init(context.get());
  if (error < 0)
    return unsupported("FFmpeg cannot use the GPU ({})", ffmpeg_error(error).message());
  return context;
}
#endif

}  // namespace

#if STGS_HAS_CUDA
Result<std::shared_ptr<VideoDevice>> VideoDevice::open(int gpu) {
  STGS_ASSIGN(const GpuContext opened, gpu_context(gpu));
  STGS_TRY(check_decoder_library());
  STGS_ASSIGN(ffmpeg::Buffer context, make_context(opened));
  return std::shared_ptr<VideoDevice>(
      new VideoDevice(opened.name, std::move(context), opened.free_bytes));
}
#else
Result<std::shared_ptr<VideoDevice>> VideoDevice::open(int gpu) {
  return gpu_context(gpu).status();
}
#endif

bool VideoDevice::reserve(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  if (bytes > limit_ - used_) return false;
  used_ += bytes;
  return true;
}

void VideoDevice::release(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  used_ -= bytes;
}

Result<VideoDecoding> choose_video_decoding(const PrepareSettings& settings, std::int64_t pixels,
                                            const LogSink& log) {
  const std::string& chosen = settings.video_decoder;
  if (chosen != "auto" && chosen != "cpu" && chosen != "cuda")
    return usage_error("unknown video decoder '{}' (expected auto, cpu or cuda)", chosen);
  const bool required = chosen == "cuda";
  const bool is_useful = required || (settings.backend != "cpu" && is_worth_start(pixels));
  if (chosen == "cpu" || !is_useful) return VideoDecoding();
  Result<std::shared_ptr<VideoDevice>> device = VideoDevice::open(settings.share.index);
  if (device.ok()) return VideoDecoding{std::move(*device), required};
  const std::string& reason = device.status().message();
  if (required) return Status(device.status().code(), reason + "; use --video-decoder cpu");
  log(2, fmt::format("NVDEC unavailable ({}); videos on the CPU", reason));
  return VideoDecoding();
}

}  // namespace stgs::encoder
