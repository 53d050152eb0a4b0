// SPDX-License-Identifier: Apache-2.0
// Drawing a scene from a viewpoint at a moment. One interface, one class a backend.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "stgs/format/math/project.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::player {

// Colour, alpha and depth of one view; channels as in RasterOutput.
struct Frame {
  Image colour, alpha, depth;
};

struct RenderStats {
  std::size_t stored = 0;  // primitives decoded and held
  std::size_t alive = 0;   // candidates at this moment
  std::size_t drawn = 0;   // splats in view
  double slice_ms = 0, bin_ms = 0, blend_ms = 0;
};

struct View {
  math::PinholeCamera camera;
  math::Vec3 background{0.0f, 0.0f, 0.0f};
};

class Timeline;

// Not thread-safe: one renderer a thread.
class Renderer {
 public:
  virtual ~Renderer() = default;
  // Draws 1 to 4 views of the same moment (seconds). `frames` is resized to the views.
  virtual Status render(Timeline& timeline, double seconds, const std::vector<View>& views,
                        std::vector<Frame>& frames, RenderStats* stats) = 0;
  virtual std::string name() const = 0;
};

// "cpu", or "auto"; "cuda" and "vulkan" answer kNotBuilt in a build without them.
Result<std::unique_ptr<Renderer>> make_renderer(const std::string& backend);

}  // namespace stgs::player
