// SPDX-License-Identifier: Apache-2.0
// Renders into memory of a CUDA device: stgs/stgs_cuda.h. In a build without CUDA, creating the
// renderer fails.
#include "stgs/stgs_cuda.h"

#include "image.h"
#include "renderer.h"
#include "scene.h"
#include "stgs/player/cuda_renderer.h"

using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

constexpr std::size_t kPixelBytes = 4;  // of RGBA8 and of a float

stgs::player::CudaPlane plane_of(const stgs_buffer& buffer, std::uint32_t width) {
  return {buffer.data, buffer.stride == 0 ? kPixelBytes * width : buffer.stride};
}

// Converts an image that has been checked.
stgs::player::CudaImage image_of(const stgs_image& from, std::uint32_t width) {
  stgs::player::CudaImage out;
  out.rgba8 = plane_of(from.rgba8, width);
  for (std::size_t c = 0; c < 3; ++c) out.planes[c] = plane_of(from.rgb[c], width);
  out.planes[3] = plane_of(from.alpha, width);
  out.planes[4] = plane_of(from.depth, width);
  return out;
}

Outcome find_backend(const stgs_renderer& renderer, stgs::player::CudaRenderer*& cuda) {
  cuda = dynamic_cast<stgs::player::CudaRenderer*>(renderer.backend.get());
  if (cuda != nullptr) return {};
  return {STGS_ERROR_UNSUPPORTED,
          fmt::format("backend '{}' cannot render into CUDA memory; create the renderer with "
                      "STGS_BACKEND_CUDA",
                      renderer.backend->name())};
}

Outcome check_rgba8(const stgs_buffer& buffer) {
  if (reinterpret_cast<std::uintptr_t>(buffer.data) % kPixelBytes == 0 &&
      buffer.stride % kPixelBytes == 0) {
    return {};
  }
  return {STGS_ERROR_ARGUMENT, "rgba8: data and stride must be multiples of 4 on a CUDA device"};
}

}  // namespace

extern "C" stgs_result stgs_cuda_render(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                                        const stgs_view* views, const stgs_image* images,
                                        uint32_t count, struct CUstream_st* stream) {
  return guarded(renderer, [&]() -> Outcome {
    stgs::player::CudaRenderer* cuda = nullptr;
    STGS_SDK_TRY(find_backend(*renderer, cuda));
    stgs::sdk::Images known;
    STGS_SDK_TRY(
        stgs::sdk::copy_in_arguments(*renderer, scene, seconds, views, images, count, known));
    std::vector<stgs::player::CudaImage> targets;
    for (std::uint32_t i = 0; i < count; ++i) {
      STGS_SDK_TRY(check_rgba8(known[i].rgba8));
      targets.push_back(
          image_of(known[i], static_cast<std::uint32_t>(renderer->views[i].camera.width)));
    }
    STGS_SDK_TRY(stgs::sdk::render(*renderer, *scene, seconds));
    return cuda->read_cuda(targets, stream);
  });
}
