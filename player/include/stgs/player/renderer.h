// SPDX-License-Identifier: Apache-2.0
// Drawing a scene from a viewpoint at a moment. One interface, one class a backend.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stgs/format/math/project.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"
#include "stgs/player/timeline.h"

struct CUstream_st;  // of CUDA

namespace stgs::player {

inline constexpr std::size_t kMaxViews = 4;

// Colour, alpha and depth of one view; channels as in RasterOutput.
struct Frame {
  Image colour, alpha, depth;
};

// What a call did; counts and times are sums over its views, except where a line says otherwise.
// A backend on a device tells the device's times of slice, bin and blend.
struct RenderStats {
  std::size_t stored = 0;  // primitives decoded and held; once a call
  std::size_t active = 0;  // candidates at this moment; once a call
  std::size_t splats = 0;  // splats in view
  // Primitives of the moment that are decoded, and that the device gets with later pictures
  // (Timeline::is_playing): these, or a better version of them, are not drawn. Once a call.
  std::size_t pending = 0;
  double fetch_ms = 0;  // finding and decoding what is alive; once a call
  double slice_ms = 0, bin_ms = 0, blend_ms = 0;
  double device_ms = 0;  // of a device, from the first to the last of it; 0 where there is none
};

// A step of drawing on a device.
struct RenderStep {
  std::string name;
  double ms = 0;
  // What it cannot do without: bytes of device memory, each buffer's read or written once, and
  // instructions a pixel (0 where they are not counted).
  double bytes = 0, operations = 0;
};
struct RenderProfile {
  // Of the device, at most: of its memory, as a copy moves them where it does not tell, and of its
  // lanes; 0 where it tells nothing of these.
  double bytes_per_second = 0, operations_per_second = 0;
  std::vector<RenderStep> steps;  // in their order
};

// Rows of pixels in memory of a CUDA device.
struct CudaPlane {
  void* data = nullptr;    // null: not wanted
  std::size_t stride = 0;  // bytes from row to row
};
// Of a view. All strides and addresses are multiples of 4.
struct CudaImage {
  CudaPlane rgba8;      // 4 bytes a pixel: colour and alpha
  CudaPlane planes[5];  // floats: red, green, blue, alpha, depth
};

struct View {
  math::PinholeCamera camera;
  math::Vec3 background{0.0f, 0.0f, 0.0f};  // sRGB-encoded
  std::optional<Fovea> fovea = {};          // of its picture; none: full resolution everywhere
};

// Not thread-safe: one renderer a thread. It keeps its buffers from call to call.
class Renderer {
 public:
  virtual ~Renderer() = default;
  // Draws 1 to kMaxViews views of the same moment (seconds); the pictures stay where the backend
  // makes them, until the next call. `stats` may be null. Errors: the number of views or a
  // camera's size (kUsage), and Timeline::at.
  virtual Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
                      RenderStats* stats) = 0;
  // The pictures of the last draw(), which succeeded, for the host; `frames` is resized to its
  // views. Once: they may be handed over.
  virtual Status read(std::vector<Frame>& frames) = 0;
  // Both.
  Status render(Timeline& timeline, double seconds, const std::vector<View>& views,
                std::vector<Frame>& frames, RenderStats* stats) {
    if (Status status = draw(timeline, seconds, views, stats); !status.ok()) return status;
    return read(frames);
  }
  // The same for memory of the CUDA device, one of `to` a view, in the order of a stream of it
  // (cudaStream_t; null: the default one) and without waiting for that; the next draw() and the
  // destructor do. kUnsupported where the backend does not draw with CUDA, kUsage where the number
  // is not that of the views.
  virtual Status read_cuda(const std::vector<CudaImage>& to, CUstream_st* stream) {
    (void)to, (void)stream;
    return unsupported("backend '{}' does not draw with CUDA", name());
  }
  virtual std::string name() const = 0;
  // Draws what the last draw() drew, which succeeded, once more, step by step. kUnsupported where
  // the backend cannot tell.
  virtual Result<RenderProfile> profile() {
    return unsupported("backend '{}' does not tell what its steps take", name());
  }
};

// "cpu", "cuda" or "vulkan"; "auto" is cuda where there is a device for it, else cpu. "cuda" and
// "vulkan" answer kNotBuilt in a build without them, kUnsupported without a device.
Result<std::unique_ptr<Renderer>> make_renderer(const std::string& backend);

// Names that make_renderer takes in this build, the one that "auto" chooses first.
std::vector<std::string> renderer_backends();

}  // namespace stgs::player
