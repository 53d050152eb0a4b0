// SPDX-License-Identifier: Apache-2.0
// The classes of the Python module, and what declares them to it.
#pragma once

#include <pybind11/numpy.h>

#include <memory>

#include "objects.h"

namespace stgs::python {

// A camera: the struct itself, whose arrays Python sees where they are.
struct View {
  stgs_view view{};
};

class Scene {
 public:
  // `source` is a path, a URL or bytes, which are borrowed as long as the scene lives.
  Scene(const py::object& source, const stgs_scene_settings& settings);
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  // Calls `call(scene)`, which gives a result, and throws where it failed.
  template <typename Call>
  void run(Call&& call) {
    const stgs_result result = unlocked([&] { return call(scene_.get()); }, mutex_);
    log_.pass_on();
    check(result, static_cast<const stgs_scene*>(scene_.get()), stgs_scene_error);
  }

  stgs_scene* get() { return scene_.get(); }
  std::mutex& mutex() { return mutex_; }
  Log& log() { return log_; }

 private:
  struct Destroy {
    void operator()(stgs_scene* scene) const { stgs_scene_destroy(scene); }
  };
  Log log_;
  std::mutex mutex_;
  py::buffer_info borrowed_;  // outlives the scene
  std::unique_ptr<stgs_scene, Destroy> scene_;
};

void declare_scene(py::module_& module);
void declare_pictures(py::module_& module);  // views, pictures and renderers

}  // namespace stgs::python
