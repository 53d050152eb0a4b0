// SPDX-License-Identifier: Apache-2.0
// Classes of the Python module and the functions that declare them.
#pragma once

#include <pybind11/numpy.h>

#include <memory>
#include <optional>
#include <string>

#include "objects.h"

namespace stgs::python {

// A camera. Python accesses the arrays of the struct in place.
struct View {
  stgs_view view{};
};

// Location of a file: a path or URL, or a buffer that is borrowed for the lifetime of this object.
class Source {
 public:
  // Throws TypeError unless it is path-like or a buffer, BufferError unless that is contiguous.
  explicit Source(const py::object& source);

  // Calls open_location(text) or open_memory(data, size).
  template <typename OpenLocation, typename OpenMemory>
  stgs_result open(OpenLocation&& open_location, OpenMemory&& open_memory) const {
    return location_ ? open_location(location_->c_str()) : open_memory(bytes_.ptr, size_);
  }

 private:
  std::optional<std::string> location_;
  py::buffer_info bytes_;
  std::size_t size_ = 0;
};

class Scene {
 public:
  Scene(const py::object& source, const stgs_scene_settings& settings);
  // The scene of a player, which must outlive it.
  Scene(stgs_scene* of_player, std::shared_ptr<Log> log);
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  // Runs call(scene) and throws Failure unless it returns STGS_OK.
  template <typename Call>
  void run(Call&& call) {
    const stgs_result result = unlocked([&] { return call(scene_.get()); }, mutex_);
    log_->flush();
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
void declare_images(py::module_& module);  // views, images and renderers
void declare_player(py::module_& module);  // after scenes

}  // namespace stgs::python
