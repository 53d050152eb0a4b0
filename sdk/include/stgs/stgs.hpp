// SPDX-License-Identifier: Apache-2.0
/// @file
/// C++17 wrapper of stgs.h: objects that release themselves, errors as exceptions. Header-only.
///
/// The rules of the C headers on threads, ownership and ranges apply. Call C functions that are not
/// wrapped with get(): stgs::check(stgs_vulkan_submit(renderer.get(), ...), renderer.get()).
#ifndef STGS_STGS_HPP
#define STGS_STGS_HPP

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "stgs/stgs.h"

#if __cplusplus >= 202002L
#include <span>
#endif

/// The C++ wrapper.
namespace stgs {
/// Keeps these types apart from types of the static library with the same name.
inline namespace hpp {

/// @defgroup api_cpp C++ wrapper
///
/// Objects that release themselves, errors as exceptions; header-only, C++17.
/// @{

#if __cplusplus >= 202002L
/// A view of contiguous elements. Before C++20 a class of this header with the members used here.
template <typename T>
using Span = std::span<T>;
#else
// The part of C++20's std::span that this header needs.
template <typename T>
class Span {
 public:
  Span(T* data, std::size_t size) : data_(data), size_(size) {}
  template <typename Container>
  Span(Container&& of) : data_(of.data()), size_(of.size()) {}  // NOLINT: implicit, as C++20's
  T* data() const { return data_; }
  std::size_t size() const { return size_; }

 private:
  T* data_;
  std::size_t size_;
};
#endif

/// A failed call; what() is the message of the object.
class Error : public std::runtime_error {
 public:
  /// An empty message stands for the name of the result.
  Error(stgs_result result, const std::string& message, std::uint64_t offset = STGS_NO_OFFSET,
        std::int32_t issue = 0)
      : std::runtime_error(message.empty() ? stgs_result_name(result) : message),
        result_(result),
        offset_(offset),
        issue_(issue) {}

  /// The result, never STGS_OK.
  stgs_result result() const { return result_; }
  /// Position in the file, bytes; STGS_NO_OFFSET: not known.
  std::uint64_t offset() const { return offset_; }
  /// Number of the file issue as in `stgs validate`; 0: none.
  std::int32_t issue() const { return issue_; }

 private:
  stgs_result result_;
  std::uint64_t offset_;
  std::int32_t issue_;
};

/// @cond
namespace detail {

inline stgs_result error_of(const stgs_scene* o, stgs_error* e) {
  return stgs_scene_error(o, e);
}
inline stgs_result error_of(const stgs_renderer* o, stgs_error* e) {
  return stgs_renderer_error(o, e);
}
inline stgs_result error_of(const stgs_player* o, stgs_error* e) {
  return stgs_player_error(o, e);
}

struct Destroy {
  void operator()(stgs_scene* scene) const { stgs_scene_destroy(scene); }
  void operator()(stgs_renderer* renderer) const { stgs_renderer_destroy(renderer); }
  void operator()(stgs_player* player) const { stgs_player_destroy(player); }
};

// A zeroed struct with its size set.
template <typename T>
T sized() {
  T out{};
  out.struct_size = sizeof(T);
  return out;
}
template <typename T, typename Defaults>
T with_defaults(Defaults defaults) {
  T out;
  if (const stgs_result result = defaults(&out, sizeof(T)); result != STGS_OK) {
    throw Error(result, "stgs.hpp does not match the version of the library");
  }
  return out;
}

}  // namespace detail
/// @endcond

/// Throws Error unless the result of a call without an object is STGS_OK.
inline void check(stgs_result result) {
  if (result != STGS_OK) throw Error(result, {});
}
/// Throws Error with the object's message unless the result of a call on it is STGS_OK.
template <typename Object>
void check(stgs_result result, const Object* object) {
  if (result == STGS_OK) return;
  stgs_error error = detail::sized<stgs_error>();
  if (detail::error_of(object, &error) != STGS_OK) throw Error(result, {});
  throw Error(result, error.message, error.offset, error.issue);
}

/// Returns the default settings of a scene.
inline stgs_scene_settings scene_settings() {
  return detail::with_defaults<stgs_scene_settings>(stgs_scene_settings_defaults);
}
/// Returns the default settings of a renderer.
inline stgs_renderer_settings renderer_settings() {
  return detail::with_defaults<stgs_renderer_settings>(stgs_renderer_settings_defaults);
}
/// Returns the default settings of a player.
inline stgs_player_settings player_settings() {
  return detail::with_defaults<stgs_player_settings>(stgs_player_settings_defaults);
}
/// Returns the default view, see stgs_view_defaults.
inline stgs_view default_view() {
  return detail::with_defaults<stgs_view>(stgs_view_defaults);
}
/// Returns an image without buffers.
inline stgs_image empty_image() {
  return detail::with_defaults<stgs_image>(stgs_image_defaults);
}
/// Returns the view with another image size and square pixels, see stgs_view_resize.
inline stgs_view resized(stgs_view view, std::uint32_t width, std::uint32_t height) {
  check(stgs_view_resize(&view, width, height));
  return view;
}
/// Returns the view with another image size and the same view angles, see stgs_view_stretch.
inline stgs_view stretched(stgs_view view, std::uint32_t width, std::uint32_t height) {
  check(stgs_view_stretch(&view, width, height));
  return view;
}
/// A point or direction, scene units.
using Vector3 = std::array<float, 3>;
/// Returns the view from `eye` to `target`, see stgs_view_look_at. `up` 0, 0, 0: as in `view`.
inline stgs_view looking_at(stgs_view view, const Vector3& eye, const Vector3& target,
                            const Vector3& up = {}) {
  check(stgs_view_look_at(&view, eye.data(), target.data(), up.data()));
  return view;
}
/// Returns the view, moved around `centre`, see stgs_view_orbit. `up` 0, 0, 0: as in `view`.
inline stgs_view orbited(stgs_view view, const Vector3& centre, double azimuth,
                         double elevation = 0, const Vector3& up = {}) {
  check(stgs_view_orbit(&view, centre.data(), up.data(), azimuth, elevation));
  return view;
}

/// Parts of the wrapper that applications do not name.
namespace detail {

/// Queries of Scene and SceneRef.
template <typename Self>
class SceneCalls {
 public:
  /// Returns the metadata.
  stgs_scene_info info() const {
    auto info = sized<stgs_scene_info>();
    check(stgs_scene_get_info(scene(), &info), scene());
    return info;
  }
  /// Returns a text of the file, or an empty string. Valid until the scene is destroyed.
  const char* text(stgs_text which) const {
    const char* text = nullptr;
    check(stgs_scene_get_text(scene(), which, &text), scene());
    return text;
  }
  /// Returns an issue of the file. `index` is 0 to info().issues - 1.
  stgs_issue issue(std::uint32_t index) const {
    auto issue = sized<stgs_issue>();
    check(stgs_scene_get_issue(scene(), index, &issue), scene());
    return issue;
  }
  /// Returns how the file stores the scene: its form, sizes and numbers.
  stgs_contents contents() const {
    auto contents = sized<stgs_contents>();
    check(stgs_scene_get_contents(scene(), &contents), scene());
    return contents;
  }
  /// Returns the demands of the file on a decoder.
  stgs_decoder_needs decoder_needs() const {
    auto needs = sized<stgs_decoder_needs>();
    check(stgs_scene_get_decoder_needs(scene(), &needs), scene());
    return needs;
  }
  /// Returns the start camera, or nothing if the file has none.
  std::optional<stgs_view> start_view() const {
    auto view = sized<stgs_view>();
    const stgs_result result = stgs_scene_start_view(scene(), &view);
    if (result == STGS_ERROR_UNSUPPORTED) return {};
    check(result, scene());
    return view;
  }
  /// Returns the view, moved so that it shows the bounds of the scene.
  stgs_view framed(stgs_view view) const {
    check(stgs_scene_frame_view(scene(), &view), scene());
    return view;
  }
  /// Returns the start camera or, if the file has none, a view of the bounds of the scene.
  stgs_view first_view() const {
    auto view = sized<stgs_view>();
    const stgs_result result = stgs_scene_start_view(scene(), &view);
    if (result == STGS_ERROR_UNSUPPORTED) return framed(view);
    check(result, scene());
    return view;
  }

 private:
  stgs_scene* scene() const { return static_cast<const Self*>(this)->get(); }
};

}  // namespace detail

/// An open .stgs file.
class Scene : public detail::SceneCalls<Scene> {
 public:
  /// Creates a scene without a file.
  explicit Scene(const stgs_scene_settings& settings = scene_settings()) {
    stgs_scene* scene = nullptr;
    check(stgs_scene_create(&settings, &scene));
    scene_.reset(scene);
  }
  /// Returns the C object, which this object owns.
  stgs_scene* get() const { return scene_.get(); }

  /// Opens a path, or an http or https URL.
  void open(const std::string& location) { check(stgs_scene_open(get(), location.c_str()), get()); }
  /// Opens a file in memory without copying it; the bytes must outlive the scene.
  void open_memory(Span<const std::uint8_t> bytes) {
    check(stgs_scene_open_memory(get(), bytes.data(), bytes.size()), get());
  }
  /// Opens a copy of a file in memory.
  void open_memory_copy(Span<const std::uint8_t> bytes) {
    check(stgs_scene_open_memory_copy(get(), bytes.data(), bytes.size()), get());
  }
  /// Cancels the scene permanently, see stgs_scene_cancel. Any thread.
  void cancel() { stgs_scene_cancel(get()); }
  /// Reads the complete file and computes the statistics of its primitives. The bins are valid
  /// until the next call.
  stgs_scene_statistics statistics() {
    auto statistics = detail::sized<stgs_scene_statistics>();
    check(stgs_scene_get_statistics(get(), &statistics), get());
    return statistics;
  }
  /// Opens a data source of the application.
  void open(const stgs_io& io) { check(stgs_scene_open_io(get(), &io), get()); }

 private:
  std::unique_ptr<stgs_scene, detail::Destroy> scene_;
};

/// Refers to the scene of a Scene or Player, which must outlive it.
class SceneRef : public detail::SceneCalls<SceneRef> {
 public:
  /// Refers to a scene that a Scene owns.
  SceneRef(const Scene& scene) : scene_(scene.get()) {}  // NOLINT: implicit by design
  /// Refers to a scene of the C interface.
  explicit SceneRef(stgs_scene* scene) : scene_(scene) {}
  /// Returns the C object.
  stgs_scene* get() const { return scene_; }

 private:
  stgs_scene* scene_;
};

/// Renders scenes.
class Renderer {
 public:
  /// Creates a renderer, see stgs_renderer_create.
  explicit Renderer(const stgs_renderer_settings& settings = renderer_settings()) {
    stgs_renderer* renderer = nullptr;
    check(stgs_renderer_create(&settings, &renderer));
    renderer_.reset(renderer);
  }
  /// Creates a renderer with a backend and otherwise the defaults.
  explicit Renderer(stgs_backend backend) : Renderer(settings_of(backend)) {}
  /// Takes ownership of a renderer, for example from stgs_vulkan_renderer_create.
  explicit Renderer(stgs_renderer* renderer) : renderer_(renderer) {}
  /// Returns the C object, which this object owns.
  stgs_renderer* get() const { return renderer_.get(); }

  /// Returns the backend in use, never STGS_BACKEND_AUTO.
  stgs_backend backend() const {
    stgs_backend backend = STGS_BACKEND_AUTO;
    check(stgs_renderer_get_backend(get(), &backend), get());
    return backend;
  }
  /// Renders 1 to STGS_MAX_VIEWS views of one time; images[i] receives views[i].
  void render(SceneRef scene, double seconds, Span<const stgs_view> views,
              Span<const stgs_image> images) {
    if (views.size() != images.size()) {
      throw Error(STGS_ERROR_ARGUMENT, "render: the numbers of views and images differ");
    }
    check(stgs_render(get(), scene.get(), seconds, views.data(), images.data(),
                      static_cast<std::uint32_t>(views.size())),
          get());
  }
  /// Renders one view.
  void render(SceneRef scene, double seconds, const stgs_view& view, const stgs_image& image) {
    check(stgs_render(get(), scene.get(), seconds, &view, &image, 1), get());
  }
  /// Renders one view and returns its pixels: red, green, blue, alpha, 8 bits each, rows
  /// contiguous.
  std::vector<std::uint8_t> render_rgba8(SceneRef scene, double seconds, const stgs_view& view) {
    std::vector<std::uint8_t> pixels(std::size_t{4} * view.width * view.height);
    stgs_image image = empty_image();
    image.rgba8 = {pixels.data(), 0, pixels.size()};
    render(scene, seconds, view, image);
    return pixels;
  }

 private:
  static stgs_renderer_settings settings_of(stgs_backend backend) {
    stgs_renderer_settings settings = renderer_settings();
    settings.backend = backend;
    return settings;
  }
  std::unique_ptr<stgs_renderer, detail::Destroy> renderer_;
};

/// @}

}  // namespace hpp
}  // namespace stgs

// The rest of the wrapper, which needs the declarations above.
#include "stgs/stgs_player.hpp"

#endif
