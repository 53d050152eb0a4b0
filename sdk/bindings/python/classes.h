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
  // Returns text for __repr__.
  std::string description() const;

 private:
  std::optional<std::string> location_;
  py::buffer_info bytes_;
  std::size_t size_ = 0;
};

class Scene {
 public:
  Scene(const py::object& source, const stgs_scene_settings& settings);
  // The scene of a player, which must outlive it.
  Scene(stgs_scene* of_player, const std::string& description, std::shared_ptr<Log> log);

  // Runs call(scene) and throws Failure unless it returns STGS_OK.
  template <typename Call>
  void run(Call&& call) {
    handle_.run(std::forward<Call>(call));
  }
  SceneHandle& handle() { return handle_; }
  // Does nothing for the scene of a player.
  void close();
  bool is_closed() { return handle_.is_closed(); }
  const std::string& description() const { return description_; }

 private:
  std::shared_ptr<Log> log_;
  std::string description_;
  std::optional<Source> source_;  // must outlive the scene; none: the scene of a player
  SceneHandle handle_;
};

// Each needs the classes that are declared before it.
void declare_view(py::module_& module);
void declare_scene(py::module_& module);
void declare_renderer(py::module_& module);  // and images
void declare_player(py::module_& module);

}  // namespace stgs::python
