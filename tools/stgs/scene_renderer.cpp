// SPDX-License-Identifier: Apache-2.0
#include "scene_renderer.h"

#include <algorithm>
#include <array>
#include <exception>

namespace stgs::tools {
namespace {

// Memory of an image while it is rendered, bytes per pixel: buffers of the renderer, as stgs_render
// states them, and of the program.
constexpr std::uint64_t kRenderedBytes = 29, kBytesPerPixel8 = kRenderedBytes + 4 + 3,
                        kBytesPerPixelFloat = kRenderedBytes + 20;
// Always allowed, bytes: images of 7680x4320 pixels with 8 bits.
constexpr std::uint64_t kMinImageMemory = std::uint64_t{5} << 28;

// Index: stgs_backend.
constexpr std::array kBackends = {"auto", "cpu", "cuda", "vulkan"};

stgs_backend backend_of(const std::string& name) {
  const auto* const found = std::find(kBackends.begin(), kBackends.end(), name);
  return static_cast<stgs_backend>(found - kBackends.begin());
}

// Keeps the message of an error, for a renderer that could not be created.
void keep_error(void* user, stgs_log_level level, const char* message) {
  if (level == STGS_LOG_ERROR) *static_cast<std::string*>(user) = message;
}

stgs_buffer buffer_of(void* data, std::size_t bytes) {
  return {data, 0, bytes};
}

stgs_buffer plane_of(Image& image, int channel) {
  return buffer_of(image.plane(channel),
                   sizeof(float) * static_cast<std::size_t>(image.width) * image.height);
}

stgs_image empty_image() {
  return sized<stgs_image>();
}

Status no_memory(const SceneFile& file, double seconds) {
  return {StatusCode::kNoMemory,
          fmt::format("{}: cannot render {:.6g} s: out of memory", file.name(), seconds)};
}

// Checks the memory of an image before it is allocated: its size may come from the file.
Status check_memory(const SceneFile& file, const stgs_view& view, std::uint64_t bytes_per_pixel) {
  const std::uint64_t bytes = bytes_per_pixel * view.width * view.height;
  if (bytes <= image_memory(file)) return {};
  return {StatusCode::kLimit,
          fmt::format("{}: an image of {}x{} pixels needs {}, more than the memory limit of {}; "
                      "reduce it with --size, or allow more memory",
                      file.name(), view.width, view.height, human_bytes(bytes),
                      human_bytes(file.memory()))};
}

}  // namespace

std::uint64_t image_memory(const SceneFile& file) {
  return std::max(file.memory(), kMinImageMemory);
}

Result<RendererPtr> create_renderer(
    const std::function<stgs_result(stgs_renderer_settings&, stgs_renderer**)>& create) {
  std::string message;
  stgs_renderer_settings settings;
  if (stgs_renderer_settings_defaults(&settings, sizeof(settings)) != STGS_OK) {
    return runtime_error("the library is older than the program");
  }
  settings.log = keep_error;
  settings.log_user = &message;
  stgs_renderer* renderer = nullptr;
  const stgs_result result = create(settings, &renderer);
  auto error = sized<stgs_error>();
  error.message = message.empty() ? stgs_result_name(result) : message.c_str();
  STGS_TRY(status_of(result, error));
  return RendererPtr(renderer);
}

Result<std::unique_ptr<SceneRenderer>> SceneRenderer::make(const std::string& backend) {
  STGS_ASSIGN(RendererPtr renderer,
              create_renderer([&](stgs_renderer_settings& settings, stgs_renderer** out) {
                settings.backend = backend_of(backend);
                settings.measure = 1;
                return stgs_renderer_create(&settings, out);
              }));
  return std::make_unique<SceneRenderer>(std::move(renderer));
}

std::string SceneRenderer::backend() const {
  stgs_backend backend = STGS_BACKEND_AUTO;
  if (stgs_renderer_get_backend(renderer_.get(), &backend) != STGS_OK) return "unknown";
  return kBackends.at(static_cast<std::size_t>(backend));
}

Status SceneRenderer::check(stgs_result result) const {
  return status_of(result, renderer_.get(), stgs_renderer_error);
}

Status SceneRenderer::render(const SceneFile& file, double seconds, const stgs_view& view,
                             const stgs_image& image) {
  return check(stgs_render(renderer_.get(), file.get(), seconds, &view, &image, 1));
}

Result<encoder::Image8> SceneRenderer::render_8bit(const SceneFile& file, double seconds,
                                                   const stgs_view& view) {
  STGS_TRY(check_memory(file, view, kBytesPerPixel8));
  const std::size_t pixels = std::size_t{view.width} * view.height;
  try {
    std::vector<std::uint8_t> rgba(4 * pixels);
    stgs_image image = empty_image();
    image.rgba8 = buffer_of(rgba.data(), rgba.size());
    STGS_TRY(render(file, seconds, view, image));
    encoder::Image8 out;
    out.width = static_cast<int>(view.width);
    out.height = static_cast<int>(view.height);
    out.channels = 3;
    out.data.resize(3 * pixels);
    for (std::size_t i = 0; i < pixels; ++i) {
      std::copy_n(rgba.data() + 4 * i, 3, out.data.data() + 3 * i);
    }
    return out;
  } catch (const std::exception&) {  // bad_alloc or length_error
    return no_memory(file, seconds);
  }
}

Result<FloatFrame> SceneRenderer::render_float(const SceneFile& file, double seconds,
                                               const stgs_view& view) {
  STGS_TRY(check_memory(file, view, kBytesPerPixelFloat));
  const int width = static_cast<int>(view.width), height = static_cast<int>(view.height);
  try {
    FloatFrame frame;
    frame.colour.reshape(width, height, 3);
    frame.alpha.reshape(width, height, 1);
    frame.depth.reshape(width, height, 1);
    stgs_image image = empty_image();
    for (int c = 0; c < 3; ++c) image.rgb[c] = plane_of(frame.colour, c);
    image.alpha = plane_of(frame.alpha, 0);
    image.depth = plane_of(frame.depth, 0);
    STGS_TRY(render(file, seconds, view, image));
    return frame;
  } catch (const std::exception&) {  // bad_alloc or length_error
    return no_memory(file, seconds);
  }
}

Result<stgs_render_statistics> SceneRenderer::statistics() const {
  auto statistics = sized<stgs_render_statistics>();
  STGS_TRY(check(stgs_renderer_get_statistics(renderer_.get(), &statistics)));
  return statistics;
}

}  // namespace stgs::tools
