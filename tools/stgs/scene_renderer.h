// SPDX-License-Identifier: Apache-2.0
// Renders scenes through the public interface of the library.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "image_io.h"
#include "scene_file.h"
#include "stgs/stgs.h"

namespace stgs::tools {

struct DestroyRenderer {
  void operator()(stgs_renderer* renderer) const { stgs_renderer_destroy(renderer); }
};
using RendererPtr = std::unique_ptr<stgs_renderer, DestroyRenderer>;

// Calls `create` with the default settings and a log. Returns the message of the library on error.
Result<RendererPtr> create_renderer(
    const std::function<stgs_result(stgs_renderer_settings&, stgs_renderer**)>& create);

// Returns the memory that an image may take, with all that makes it, bytes.
std::uint64_t image_memory(const SceneFile& file);

class SceneRenderer {
 public:
  // Makes a renderer: auto, cpu, cuda or vulkan.
  static Result<std::unique_ptr<SceneRenderer>> make(const std::string& backend);
  // Used by make().
  explicit SceneRenderer(RendererPtr renderer) : renderer_(std::move(renderer)) {}

  // Returns the name of the backend in use, never auto.
  std::string backend() const;
  // Renders a view of a time, seconds, as 8-bit RGB or as floats. Returns kNoMemory if the image
  // does not fit into memory.
  Result<encoder::Image8> render_8bit(const SceneFile& file, double seconds, const stgs_view& view);
  Result<FloatFrame> render_float(const SceneFile& file, double seconds, const stgs_view& view);
  // Returns the counts and times of the last call that succeeded.
  Result<stgs_render_statistics> statistics() const;

 private:
  Status check(stgs_result result) const;
  Status render(const SceneFile& file, double seconds, const stgs_view& view,
                const stgs_image& image);

  RendererPtr renderer_;
};

}  // namespace stgs::tools
