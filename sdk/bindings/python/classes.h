// SPDX-License-Identifier: Apache-2.0
// The classes of the Python module, and what declares them to it.
#pragma once

#include <pybind11/numpy.h>

#include <memory>
#include <optional>
#include <string>

#include "objects.h"

namespace stgs::python {

// A camera: the struct itself, whose arrays Python sees where they are.
struct View {
  stgs_view view{};
};

// Where a file comes from: a path or URL, or bytes that are borrowed as long as this lives.
class Source {
 public:
  // ValueError and TypeError where it is neither.
  explicit Source(const py::object& source);

  // Calls open_place(text) or open_memory(data, size).
  template <typename OpenPlace, typename OpenMemory>
  stgs_result open(OpenPlace&& open_place, OpenMemory&& open_memory) const {
    return place_ ? open_place(place_->c_str()) : open_memory(bytes_.ptr, size_);
  }

 private:
  std::optional<std::string> place_;
  py::buffer_info bytes_;
  std::size_t size_ = 0;
};

class Scene {
 public:
  Scene(const py::object& source, const stgs_scene_settings& settings);
  // A player's, which outlives it.
  Scene(stgs_scene* of_player, std::shared_ptr<Log> log);
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  // Calls `call(scene)`, which gives a result, and throws where it failed.
  template <typename Call>
  void run(Call&& call) {
    const stgs_result result = unlocked([&] { return call(scene_.get()); }, mutex_);
    log_->pass_on();
    check(result, static_cast<const stgs_scene*>(scene_.get()), stgs_scene_error);
  }

  stgs_scene* get() { return scene_.get(); }
  std::mutex& mutex() { return mutex_; }
  Log& log() { return *log_; }

 private:
  struct Destroy {
    void operator()(stgs_scene* scene) const { stgs_scene_destroy(scene); }
  };
  std::shared_ptr<Log> log_;
  std::mutex mutex_;
  std::optional<Source> source_;  // outlives the scene
  std::unique_ptr<stgs_scene, Destroy> scene_;
};

void declare_scene(py::module_& module);
void declare_pictures(py::module_& module);  // views, pictures and renderers
void declare_player(py::module_& module);    // after scenes

}  // namespace stgs::python
