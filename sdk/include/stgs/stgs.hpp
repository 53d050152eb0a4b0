// SPDX-License-Identifier: Apache-2.0
// stgs.h for C++17 and later: objects that end by themselves, errors as exceptions. Header only;
// what the C headers say of threads, ownership and ranges holds here.
//
// What is not wrapped is called with get(): stgs::check(stgs_vulkan_submit(renderer.get(), ...)).
#ifndef STGS_STGS_HPP
#define STGS_STGS_HPP

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

// Named, so that no type of the library's own, in the static one, has the same name.
namespace stgs {
inline namespace hpp {

#if __cplusplus >= 202002L
template <typename T>
using Span = std::span<T>;
#else
// What is needed of C++20's: elements of somebody else's, side by side.
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

// A result other than STGS_OK, in words.
class Error : public std::runtime_error {
 public:
  Error(stgs_result result, const std::string& message, std::uint64_t offset = STGS_NO_OFFSET,
        std::int32_t issue = 0)
      : std::runtime_error(message.empty() ? stgs_result_name(result) : message),
        result_(result),
        offset_(offset),
        issue_(issue) {}

  stgs_result result() const { return result_; }
  std::uint64_t offset() const { return offset_; }  // of the file; STGS_NO_OFFSET: not known
  std::int32_t issue() const { return issue_; }     // of the file; 0: none

 private:
  stgs_result result_;
  std::uint64_t offset_;
  std::int32_t issue_;
};

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

// A struct that begins with its size.
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
    throw Error(result, "stgs.hpp and the library do not fit together");
  }
  return out;
}

}  // namespace detail

// Throws what a call without an object, or one that makes an object, ended with.
inline void check(stgs_result result) {
  if (result != STGS_OK) throw Error(result, {});
}
// Throws what a call on an object ended with, with the object's words.
template <typename Object>
void check(stgs_result result, const Object* object) {
  if (result == STGS_OK) return;
  stgs_error error = detail::sized<stgs_error>();
  if (detail::error_of(object, &error) != STGS_OK) throw Error(result, {});
  throw Error(result, error.message, error.offset, error.issue);
}

inline stgs_scene_settings scene_settings() {
  return detail::with_defaults<stgs_scene_settings>(stgs_scene_settings_defaults);
}
inline stgs_renderer_settings renderer_settings() {
  return detail::with_defaults<stgs_renderer_settings>(stgs_renderer_settings_defaults);
}
inline stgs_player_settings player_settings() {
  return detail::with_defaults<stgs_player_settings>(stgs_player_settings_defaults);
}
inline stgs_view default_view() {
  return detail::with_defaults<stgs_view>(stgs_view_defaults);
}
inline stgs_image no_picture() {
  return detail::with_defaults<stgs_image>(stgs_image_defaults);
}
inline stgs_view resized(stgs_view view, std::uint32_t width, std::uint32_t height) {
  check(stgs_view_resize(&view, width, height));
  return view;
}

namespace detail {

// What can be asked of a scene, whoever's it is.
template <typename Self>
class SceneCalls {
 public:
  stgs_scene_info info() const {
    auto info = sized<stgs_scene_info>();
    check(stgs_scene_get_info(scene(), &info), scene());
    return info;
  }
  // As long as the scene.
  const char* text(stgs_text which) const {
    const char* text = nullptr;
    check(stgs_scene_get_text(scene(), which, &text), scene());
    return text;
  }
  // `index` from 0 to info().issues - 1.
  stgs_issue issue(std::uint32_t index) const {
    auto issue = sized<stgs_issue>();
    check(stgs_scene_get_issue(scene(), index, &issue), scene());
    return issue;
  }
  // Nothing where the file has no start camera.
  std::optional<stgs_view> start_view() const {
    auto view = sized<stgs_view>();
    const stgs_result result = stgs_scene_start_view(scene(), &view);
    if (result == STGS_ERROR_UNSUPPORTED) return {};
    check(result, scene());
    return view;
  }
  // The view from where it shows all of the scene.
  stgs_view framed(stgs_view view) const {
    check(stgs_scene_frame_view(scene(), &view), scene());
    return view;
  }
  // The start camera; where the file has none, a view of all of the scene.
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

class Scene : public detail::SceneCalls<Scene> {
 public:
  explicit Scene(const stgs_scene_settings& settings = scene_settings()) {
    stgs_scene* scene = nullptr;
    check(stgs_scene_create(&settings, &scene));
    scene_.reset(scene);
  }
  stgs_scene* get() const { return scene_.get(); }

  void open(const std::string& place) { check(stgs_scene_open(get(), place.c_str()), get()); }
  // The bytes must stay until the scene ends.
  void open_memory(Span<const std::uint8_t> bytes) {
    check(stgs_scene_open_memory(get(), bytes.data(), bytes.size()), get());
  }
  void open_memory_copy(Span<const std::uint8_t> bytes) {
    check(stgs_scene_open_memory_copy(get(), bytes.data(), bytes.size()), get());
  }
  void open(const stgs_io& io) { check(stgs_scene_open_io(get(), &io), get()); }

 private:
  std::unique_ptr<stgs_scene, detail::Destroy> scene_;
};

// A Scene's or a Player's scene, while that lives.
class SceneRef : public detail::SceneCalls<SceneRef> {
 public:
  SceneRef(const Scene& scene) : scene_(scene.get()) {}  // NOLINT: implicit by design
  explicit SceneRef(stgs_scene* scene) : scene_(scene) {}
  stgs_scene* get() const { return scene_; }

 private:
  stgs_scene* scene_;
};

class Renderer {
 public:
  explicit Renderer(const stgs_renderer_settings& settings = renderer_settings()) {
    stgs_renderer* renderer = nullptr;
    check(stgs_renderer_create(&settings, &renderer));
    renderer_.reset(renderer);
  }
  explicit Renderer(stgs_backend backend) : Renderer(settings_of(backend)) {}
  // Takes one, as stgs_vulkan_renderer_create makes it.
  explicit Renderer(stgs_renderer* renderer) : renderer_(renderer) {}
  stgs_renderer* get() const { return renderer_.get(); }

  stgs_backend backend() const {
    stgs_backend backend = STGS_BACKEND_AUTO;
    check(stgs_renderer_get_backend(get(), &backend), get());
    return backend;
  }
  // pictures[i] gets views[i].
  void render(SceneRef scene, double seconds, Span<const stgs_view> views,
              Span<const stgs_image> pictures) {
    if (views.size() != pictures.size()) {
      throw Error(STGS_ERROR_ARGUMENT, "as many pictures as views");
    }
    check(stgs_render(get(), scene.get(), seconds, views.data(), pictures.data(),
                      static_cast<std::uint32_t>(views.size())),
          get());
  }
  void render(SceneRef scene, double seconds, const stgs_view& view, const stgs_image& picture) {
    check(stgs_render(get(), scene.get(), seconds, &view, &picture, 1), get());
  }
  // A picture of 8 bits: red, green, blue, alpha; rows side by side.
  std::vector<std::uint8_t> render_rgba8(SceneRef scene, double seconds, const stgs_view& view) {
    std::vector<std::uint8_t> pixels(std::size_t{4} * view.width * view.height);
    stgs_image picture = no_picture();
    picture.rgba8 = {pixels.data(), 0, pixels.size()};
    render(scene, seconds, view, picture);
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

// stgs_player_event with words of its own.
struct PlayerEvent {
  stgs_event_kind kind = STGS_EVENT_NONE;
  stgs_result result = STGS_OK;
  double seconds = 0;
  std::uint64_t offset = STGS_NO_OFFSET;
  std::int32_t layers = 0;
  std::string message;
};

class Player {
 public:
  explicit Player(const stgs_player_settings& settings = player_settings()) {
    stgs_player* player = nullptr;
    check(stgs_player_create(&settings, &player));
    player_.reset(player);
  }
  stgs_player* get() const { return player_.get(); }
  SceneRef scene() const { return SceneRef(stgs_player_scene(get())); }

  void open(const std::string& place) { check(stgs_player_open(get(), place.c_str()), get()); }
  // The bytes must stay until the player ends.
  void open_memory(Span<const std::uint8_t> bytes) {
    check(stgs_player_open_memory(get(), bytes.data(), bytes.size()), get());
  }
  void open_memory_copy(Span<const std::uint8_t> bytes) {
    check(stgs_player_open_memory_copy(get(), bytes.data(), bytes.size()), get());
  }
  void open(const stgs_io& io) { check(stgs_player_open_io(get(), &io), get()); }
  void open(const stgs_async_io& io) { check(stgs_player_open_async_io(get(), &io), get()); }
  // Throws what opening ended with.
  void wait_open() { check(stgs_player_wait_open(get()), get()); }

  void play() { check(stgs_player_play(get()), get()); }
  void pause() { check(stgs_player_pause(get()), get()); }
  void seek(double seconds) { check(stgs_player_seek(get(), seconds), get()); }
  void seek_frame(std::uint32_t frame) { check(stgs_player_seek_frame(get(), frame), get()); }
  void set_rate(double rate) { check(stgs_player_set_rate(get(), rate), get()); }
  void set_loop(bool loop) { check(stgs_player_set_loop(get(), loop ? 1 : 0), get()); }

  void go_live() { check(stgs_player_go_live(get()), get()); }
  stgs_player_live live() const {
    auto live = detail::sized<stgs_player_live>();
    check(stgs_player_get_live(get(), &live), get());
    return live;
  }

  stgs_player_status update(double now) {
    auto status = detail::sized<stgs_player_status>();
    check(stgs_player_update(get(), now, &status), get());
    return status;
  }
  // Nothing: there is no more.
  std::optional<PlayerEvent> next_event() {
    auto event = detail::sized<stgs_player_event>();
    check(stgs_player_next_event(get(), &event), get());
    if (event.kind == STGS_EVENT_NONE) return {};
    return PlayerEvent{event.kind,   event.result, event.seconds,
                       event.offset, event.layers, event.message};
  }
  stgs_player_statistics statistics() const {
    auto statistics = detail::sized<stgs_player_statistics>();
    check(stgs_player_get_statistics(get(), &statistics), get());
    return statistics;
  }
  std::vector<stgs_time_range> buffered() const {
    std::vector<stgs_time_range> ranges(8);
    for (;;) {
      std::uint32_t count = 0;
      check(stgs_player_get_buffered(get(), ranges.data(),
                                     static_cast<std::uint32_t>(ranges.size()), &count),
            get());
      const bool all = count <= ranges.size();
      ranges.resize(count);
      if (all) return ranges;
    }
  }

 private:
  std::unique_ptr<stgs_player, detail::Destroy> player_;
};

}  // namespace hpp
}  // namespace stgs

#endif
