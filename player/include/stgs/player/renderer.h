// SPDX-License-Identifier: Apache-2.0
// Drawing a scene from a viewpoint at a moment. One interface, one class a backend.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "stgs/format/math/project.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"
#include "stgs/player/timeline.h"

namespace stgs::player {

inline constexpr std::size_t kMaxViews = 4;

// Colour, alpha and depth of one view; channels as in RasterOutput.
struct Frame {
  Image colour, alpha, depth;
};

// What a call did; counts and times are sums over its views, except where a line says otherwise.
struct RenderStats {
  std::size_t stored = 0;  // primitives decoded and held; once a call
  std::size_t alive = 0;   // candidates at this moment; once a call
  std::size_t drawn = 0;   // splats in view
  double fetch_ms = 0;     // finding and decoding what is alive; once a call
  double slice_ms = 0, bin_ms = 0, blend_ms = 0;
};

struct View {
  math::PinholeCamera camera;
  math::Vec3 background{0.0f, 0.0f, 0.0f};  // sRGB-encoded
};

// Not thread-safe: one renderer a thread. It keeps its buffers from call to call.
class Renderer {
 public:
  virtual ~Renderer() = default;
  // Draws 1 to kMaxViews views of the same moment (seconds). `frames` is resized to the views;
  // `stats` may be null. Errors: the number of views or a camera's size (kUsage), and Timeline::at.
  virtual Status render(Timeline& timeline, double seconds, const std::vector<View>& views,
                        std::vector<Frame>& frames, RenderStats* stats) = 0;
  virtual std::string name() const = 0;
};

// "cpu", or "auto"; "cuda" and "vulkan" answer kNotBuilt in a build without them.
Result<std::unique_ptr<Renderer>> make_renderer(const std::string& backend);

// Names that make_renderer takes in this build, the one that "auto" chooses first.
std::vector<std::string> renderer_backends();

}  // namespace stgs::player
