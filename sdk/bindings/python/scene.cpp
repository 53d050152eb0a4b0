// SPDX-License-Identifier: Apache-2.0
#include <pybind11/stl.h>

#include "classes.h"

namespace stgs::python {
namespace {

using Floats = py::array_t<float>;

// Arrays that stgs_scene_get_primitives fills.
struct Primitives {
  py::array_t<std::uint32_t> id;
  Floats position, velocity, scale, rotation, opacity, sh;
};

// Returns a NumPy array of n rows.
Floats rows(std::uint64_t n, py::ssize_t columns) {
  return Floats({static_cast<py::ssize_t>(n), columns});
}

stgs_scene_info info_of(Scene& scene) {
  auto info = sized<stgs_scene_info>();
  scene.run([&](stgs_scene* s) { return stgs_scene_get_info(s, &info); });
  return info;
}

std::string text_of(Scene& scene, stgs_text which) {
  std::string out;
  scene.run([&](stgs_scene* s) {
    const char* text = "";
    const stgs_result result = stgs_scene_get_text(s, which, &text);
    out = text;
    return result;
  });
  return out;
}

std::vector<py::dict> issues_of(Scene& scene) {
  std::vector<py::dict> out;
  const std::uint32_t count = info_of(scene).issues;
  for (std::uint32_t i = 0; i < count; ++i) {
    auto issue = sized<stgs_issue>();
    std::string message;
    scene.run([&](stgs_scene* s) {
      const stgs_result result = stgs_scene_get_issue(s, i, &issue);
      if (result == STGS_OK) message = issue.message;
      return result;
    });
    out.push_back(py::dict(py::arg("number") = issue.number,
                           py::arg("is_error") = issue.is_error != 0,
                           py::arg("offset") = issue.offset, py::arg("message") = message));
  }
  return out;
}

View start_view(Scene& scene) {
  View out;
  out.view = sized<stgs_view>();
  scene.run([&](stgs_scene* s) { return stgs_scene_start_view(s, &out.view); });
  return out;
}

View framed(Scene& scene, View view) {
  scene.run([&](stgs_scene* s) { return stgs_scene_frame_view(s, &view.view); });
  return view;
}

View first_view(Scene& scene) {
  View out;
  out.view = sized<stgs_view>();
  bool has_none = false;
  scene.run([&](stgs_scene* s) {
    const stgs_result result = stgs_scene_start_view(s, &out.view);
    has_none = result == STGS_ERROR_UNSUPPORTED;
    return has_none ? STGS_OK : result;
  });
  return has_none ? framed(scene, out) : out;
}

Primitives primitives_at(Scene& scene, double seconds) {
  const int degree = info_of(scene).sh_degree;
  std::uint64_t count = 0, capacity = 0;
  Primitives out;
  // Repeated if more data arrived or another thread used the scene between the two calls.
  do {
    scene.run(
        [&](stgs_scene* s) { return stgs_scene_get_primitives(s, seconds, nullptr, &capacity); });
    out = {py::array_t<std::uint32_t>(static_cast<py::ssize_t>(capacity)),
           rows(capacity, 3),
           rows(capacity, 3),
           rows(capacity, 3),
           rows(capacity, 4),
           Floats(static_cast<py::ssize_t>(capacity)),
           Floats({static_cast<py::ssize_t>(capacity), py::ssize_t{degree + 1} * (degree + 1),
                   py::ssize_t{3}})};
    auto arrays = sized<stgs_primitives>();
    arrays.capacity = capacity;
    arrays.id = out.id.mutable_data();
    arrays.position = out.position.mutable_data();
    arrays.velocity = out.velocity.mutable_data();
    arrays.scale = out.scale.mutable_data();
    arrays.rotation = out.rotation.mutable_data();
    arrays.opacity = out.opacity.mutable_data();
    arrays.sh = out.sh.mutable_data();
    scene.run(
        [&](stgs_scene* s) { return stgs_scene_get_primitives(s, seconds, &arrays, &count); });
  } while (count != capacity);
  return out;
}

std::unique_ptr<Scene> open(const py::object& source, std::optional<std::uint64_t> memory_budget,
                            std::optional<std::uint64_t> max_file_bytes,
                            std::optional<std::uint64_t> max_primitives,
                            std::optional<std::uint64_t> max_memory, bool reject_damage,
                            std::optional<double> url_timeout_seconds,
                            std::optional<double> url_min_bytes_per_second,
                            bool url_allow_private) {
  stgs_scene_settings settings;
  stgs_scene_settings_defaults(&settings, sizeof settings);
  settings.memory_budget = memory_budget.value_or(settings.memory_budget);
  settings.max_file_bytes = max_file_bytes.value_or(settings.max_file_bytes);
  settings.max_primitives = max_primitives.value_or(settings.max_primitives);
  settings.max_memory = max_memory.value_or(settings.max_memory);
  settings.reject_damage = reject_damage ? 1 : 0;
  settings.url_timeout_seconds = url_timeout_seconds.value_or(settings.url_timeout_seconds);
  settings.url_min_bytes_per_second =
      url_min_bytes_per_second.value_or(settings.url_min_bytes_per_second);
  settings.url_allow_private = url_allow_private ? 1 : 0;
  return std::make_unique<Scene>(source, settings);
}

template <std::size_t N>
std::vector<float> list_of(const float (&values)[N]) {
  return {values, values + N};
}

double fps_of(const stgs_scene_info& info) {
  return double(info.time_base_denominator) / info.time_base_numerator;
}

std::string repr_of_info(const stgs_scene_info& info) {
  return format("<stgs.SceneInfo {:.3f} s, {} frames at {:.5g} fps, {} primitives>",
                info.duration_seconds, info.frames, fps_of(info), info.primitives);
}

std::string repr_of_scene(Scene& scene) {
  if (scene.is_closed()) return format("<stgs.Scene {}, closed>", scene.description());
  try {
    const stgs_scene_info info = info_of(scene);
    return format("<stgs.Scene {}, {:.3f} s, {} frames, {} primitives>", scene.description(),
                  info.duration_seconds, info.frames, info.primitives);
  } catch (const Failure&) {
    return format("<stgs.Scene {}, not open>", scene.description());
  }
}

void declare_info(py::module_& module) {
  using Info = stgs_scene_info;
  py::class_<Info>(module, "SceneInfo", "Metadata of a scene; see stgs_scene_info.")
      .def_property_readonly(
          "format", [](const Info& i) { return py::make_tuple(i.format_major, i.format_minor); })
      .def_readonly("frames", &Info::frames)
      .def_property_readonly("fps", &fps_of)
      .def_readonly("duration_seconds", &Info::duration_seconds)
      .def_readonly("complete_seconds", &Info::complete_seconds)
      .def_readonly("primitives", &Info::primitives)
      .def_readonly("file_bytes", &Info::file_bytes)
      .def_readonly("memory_bytes", &Info::memory_bytes)
      .def_readonly("sh_degree", &Info::sh_degree)
      .def_readonly("kernel", &Info::kernel)
      .def_property_readonly("has_start_camera",
                             [](const Info& i) { return i.has_start_camera != 0; })
      .def_property_readonly("bounds_min", [](const Info& i) { return list_of(i.bounds_min); })
      .def_property_readonly("bounds_max", [](const Info& i) { return list_of(i.bounds_max); })
      .def_readonly("metres_per_unit", &Info::metres_per_unit)
      .def_property_readonly("up", [](const Info& i) { return list_of(i.up); })
      .def_property_readonly("floor", [](const Info& i) { return list_of(i.floor); })
      .def("__repr__", &repr_of_info);
}

void declare_primitives(py::module_& module) {
  py::class_<Primitives>(module, "Primitives",
                         "Primitives visible at one time: NumPy arrays with one row per primitive.")
      .def("__len__", [](const Primitives& p) { return p.id.size(); })
      .def("__repr__",
           [](const Primitives& p) {
             return format("<stgs.Primitives, {} primitives>", p.id.size());
           })
      .def_readonly("id", &Primitives::id, "(N,) index in the file")
      .def_readonly("position", &Primitives::position, "(N, 3) scene units")
      .def_readonly("velocity", &Primitives::velocity, "(N, 3) scene units per second")
      .def_readonly("scale", &Primitives::scale,
                    "(N, 3) standard deviations along the axes, scene units")
      .def_readonly("rotation", &Primitives::rotation, "(N, 4) unit quaternions w, x, y, z")
      .def_readonly("opacity", &Primitives::opacity, "(N,) at the time, 1/255 to 1")
      .def_readonly("sh", &Primitives::sh, "(N, (sh_degree + 1)^2, 3) spherical harmonics");
}

}  // namespace

Source::Source(const py::object& source) {
  if (PyObject_CheckBuffer(source.ptr()) == 0) {
    location_ = py::module_::import("os").attr("fspath")(source).cast<std::string>();
    return;
  }
  bytes_ = py::reinterpret_borrow<py::buffer>(source).request();
  if (PyBuffer_IsContiguous(bytes_.view(), 'C') == 0)
    throw py::buffer_error("source: the buffer must be contiguous");
  size_ = static_cast<std::size_t>(bytes_.size * bytes_.itemsize);
}

std::string Source::description() const {
  if (location_) return py::repr(py::str(*location_)).cast<std::string>();
  return format("of {} bytes", size_);
}

Scene::Scene(const py::object& source, const stgs_scene_settings& settings)
    : log_(std::make_shared<Log>()), source_(source), handle_("scene", log_) {
  description_ = source_->description();
  stgs_scene_settings own = settings;
  own.log = Log::append;
  own.log_user = log_.get();
  stgs_scene* created = nullptr;
  if (const stgs_result result = stgs_scene_create(&own, &created); result != STGS_OK)
    throw Failure(result, "a limit is out of range");
  handle_.set(created);
  run([&](stgs_scene* s) {
    return source_->open(
        [&](const char* location) { return stgs_scene_open(s, location); },
        [&](const void* data, std::size_t size) { return stgs_scene_open_memory(s, data, size); });
  });
}

// stgs_scene_destroy does nothing for the scene of a player.
Scene::Scene(stgs_scene* of_player, const std::string& description, std::shared_ptr<Log> log)
    : log_(std::move(log)), description_(description), handle_("player", log_) {
  handle_.set(of_player);
}

void Scene::close() {
  if (!source_) return;
  handle_.close();
  source_.reset();
}

void declare_scene(py::module_& module) {
  declare_info(module);
  declare_primitives(module);
  py::class_<Scene> scene(
      module, "Scene",
      "An open scene. `source` is a path, a URL, or a buffer with a file (bytes, "
      "bytearray, memoryview, mmap), which is not copied and must not change. A "
      "context manager, which closes it.");
  add_closing(scene, "Releases the file and its memory. Does nothing for the scene of a player.");
  scene
      .def(py::init(&open), py::arg("source"), py::kw_only(), py::arg("memory_budget") = py::none(),
           py::arg("max_file_bytes") = py::none(), py::arg("max_primitives") = py::none(),
           py::arg("max_memory") = py::none(), py::arg("reject_damage") = false,
           py::arg("url_timeout_seconds") = py::none(),
           py::arg("url_min_bytes_per_second") = py::none(), py::arg("url_allow_private") = false)
      .def_property_readonly("info", &info_of)
      .def_property_readonly("title", [](Scene& s) { return text_of(s, STGS_TEXT_TITLE); })
      .def_property_readonly("generator", [](Scene& s) { return text_of(s, STGS_TEXT_GENERATOR); })
      .def_property_readonly("audio", [](Scene& s) { return text_of(s, STGS_TEXT_AUDIO); })
      .def_property_readonly("issues", &issues_of,
                             "Issues found when the file was opened: dicts with number, is_error, "
                             "offset and message.")
      .def("start_view", &start_view, "Returns the start camera of the file; Error if it has none.")
      .def("first_view", &first_view,
           "Returns the start camera or, if the file has none, a view of the whole scene.")
      .def("framed", &framed, py::arg("view"),
           "Returns the view, moved so that it shows the whole scene; direction and lens stay.")
      .def("primitives", &primitives_at, py::arg("seconds"),
           "Returns the primitives visible at a time.")
      .def("__repr__", &repr_of_scene);
}

}  // namespace stgs::python
