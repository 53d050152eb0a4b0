// SPDX-License-Identifier: Apache-2.0
// Renders a scene from viewpoints at a time. One interface, with one class per backend.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stgs/format/math/project.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"
#include "stgs/player/timeline.h"

namespace stgs::player {

inline constexpr std::size_t kMaxViews = 4;  // per call

// Colour, alpha and depth of one view; channels as in RasterOutput. Colours are sRGB with the
// primaries of BT.709: those of a scene with another encoding are converted (spec 4.4).
struct Frame {
  Image colour, alpha, depth;
};

// Counts and times of a call, summed over its views unless stated otherwise. GPU backends report
// device times for slice, bin and blend.
struct RenderStats {
  std::size_t stored = 0;  // primitives decoded and resident; per call
  std::size_t active = 0;  // candidate primitives at this time; per call
  std::size_t splats = 0;  // visible splats
  // Decoded primitives whose upload is deferred to later frames (Timeline::is_playing): they, or a
  // better version of them, are not rendered yet. Per call.
  std::size_t pending = 0;
  double fetch_ms = 0;  // finding and decoding the active segments; per call
  double slice_ms = 0, bin_ms = 0, blend_ms = 0;
  double device_ms = 0;  // from the beginning to the end of the device's work; 0 for the CPU
};

// One step of rendering on a device.
struct RenderStep {
  std::string name;
  double ms = 0;
  // Lower bounds: bytes of device memory if each buffer is read or written once, and instructions
  // (0 if they are not counted).
  double bytes = 0, operations = 0;
};
// The steps of a frame next to the limits of the device.
struct RenderProfile {
  // Peak rates of the device's memory (measured with a copy if the device does not report it) and
  // of its lanes; 0 if not known.
  double bytes_per_second = 0, operations_per_second = 0;
  std::vector<RenderStep> steps;  // in execution order
};

// A viewpoint.
struct View {
  math::PinholeCamera camera;
  math::Vec3 background{0.0f, 0.0f, 0.0f};  // in the encoding of the scene
  std::optional<Fovea> fovea = {};  // region of full resolution; not set: the complete image
};

// Renders frames and retains its buffers between calls. Not thread-safe: one thread per renderer.
class Renderer {
 public:
  virtual ~Renderer() = default;
  // Renders 1 to kMaxViews views of the scene at `seconds`. The images stay on the backend until
  // the next call. `stats` may be null. Errors: kUsage for the number of views or the size of a
  // camera, kLimit if the images and the working memory need more than the memory budget of the
  // timeline and more than 1 GiB (Timeline::budget()), and those of Timeline::at(). The renderer
  // remains usable.
  virtual Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
                      RenderStats* stats) = 0;
  // Returns the images of the last successful draw() in host memory and resizes `frames` to its
  // views. Call it once per draw(): the buffers may be handed over.
  virtual Status read(std::vector<Frame>& frames) = 0;
  // Calls draw(), then read().
  Status render(Timeline& timeline, double seconds, const std::vector<View>& views,
                std::vector<Frame>& frames, RenderStats* stats) {
    if (Status status = draw(timeline, seconds, views, stats); !status.ok()) return status;
    return read(frames);
  }
  // Returns the name of the backend, as make_renderer() takes it.
  virtual std::string name() const = 0;
  // Renders the last successful draw() again, step by step, and measures each step. kUnsupported if
  // the backend cannot measure them.
  virtual Result<RenderProfile> profile() {
    return unsupported("backend '{}' cannot profile its steps", name());
  }
};

// Creates a renderer: "cpu", "cuda", "vulkan", or "auto" for CUDA if a device is present, else the
// CPU. "cuda" and "vulkan" fail with kNotBuilt if the build lacks them and with kUnsupported if
// there is no suitable device. Other names: kUsage.
Result<std::unique_ptr<Renderer>> make_renderer(const std::string& backend);

// Returns the backends in this build, starting with the one that "auto" prefers.
std::vector<std::string> renderer_backends();

}  // namespace stgs::player
