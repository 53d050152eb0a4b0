// SPDX-License-Identifier: Apache-2.0
// Views, pictures and renderers.
#include <pybind11/stl.h>

#include <array>

#include "classes.h"

namespace stgs::python {
namespace {

// numpy's arrays that the library draws into; None: not wanted.
struct Picture {
  py::object rgba8 = py::none(), rgb = py::none(), alpha = py::none(), depth = py::none();
};

class Renderer {
 public:
  explicit Renderer(const std::string& backend) {
    stgs_renderer_settings settings;
    stgs_renderer_settings_defaults(&settings, sizeof settings);
    settings.backend = backend_of(backend);
    settings.log = Log::take;
    settings.log_user = &log_;
    stgs_renderer* made = nullptr;
    std::string message;
    const stgs_result result =
        unlocked([&] { return stgs_renderer_create(&settings, &made); }, mutex_);
    log_.pass_on();
    if (result != STGS_OK) throw Failure(result, "no renderer for the backend '" + backend + "'");
    renderer_.reset(made);
  }

  std::string backend() {
    stgs_backend backend = STGS_BACKEND_AUTO;
    const stgs_result result =
        unlocked([&] { return stgs_renderer_get_backend(renderer_.get(), &backend); }, mutex_);
    check(result, static_cast<const stgs_renderer*>(renderer_.get()), stgs_renderer_error);
    return kBackends.at(static_cast<std::size_t>(backend));
  }

  void render(Scene& scene, double seconds, const std::vector<stgs_view>& views,
              const std::vector<stgs_image>& pictures) {
    const stgs_result result = unlocked(
        [&] {
          return stgs_render(renderer_.get(), scene.get(), seconds, views.data(), pictures.data(),
                             static_cast<std::uint32_t>(views.size()));
        },
        mutex_, scene.mutex());
    log_.pass_on();
    scene.log().pass_on();
    check(result, static_cast<const stgs_renderer*>(renderer_.get()), stgs_renderer_error);
  }

 private:
  // Index: stgs_backend.
  static constexpr std::array<const char*, 4> kBackends = {"auto", "cpu", "cuda", "vulkan"};
  static stgs_backend backend_of(const std::string& name) {
    for (std::size_t i = 0; i < kBackends.size(); ++i) {
      if (name == kBackends[i]) return static_cast<stgs_backend>(i);
    }
    throw Failure(STGS_ERROR_ARGUMENT, "there is no backend '" + name + "'");
  }
  struct Destroy {
    void operator()(stgs_renderer* renderer) const { stgs_renderer_destroy(renderer); }
  };
  Log log_;
  std::mutex mutex_;
  std::unique_ptr<stgs_renderer, Destroy> renderer_;
};

// The memory of an array of `rows` x `columns` pixels of `channels` elements, whose rows may lie
// apart; a wrong array is an error of the caller's.
template <typename T>
stgs_buffer buffer_of(const py::object& object, const char* name, py::ssize_t rows,
                      py::ssize_t columns, py::ssize_t channels) {
  if (object.is_none()) return {};
  const auto wrong = [&](const std::string& why) {
    return py::value_error(std::string(name) + ": " + why);
  };
  if (!py::isinstance<py::array_t<T>>(object)) throw wrong("not a numpy array of its type");
  auto array = py::reinterpret_borrow<py::array>(object);
  const bool flat = array.ndim() == 2 && channels == 1;
  if (!flat && !(array.ndim() == 3 && array.shape(2) == channels))
    throw wrong("not of the shape of the picture");
  if (array.shape(0) != rows || array.shape(1) != columns)
    throw wrong("not of the size of the view");
  if (!array.writeable()) throw wrong("not writeable");
  const auto pixel = static_cast<py::ssize_t>(sizeof(T)) * channels;
  const bool dense = array.strides(1) == pixel &&
                     (flat || array.strides(2) == static_cast<py::ssize_t>(sizeof(T)));
  if (!dense || array.strides(0) < pixel * columns)
    throw wrong("the pixels of a row must lie side by side");
  const auto stride = static_cast<std::size_t>(array.strides(0));
  return {array.mutable_data(), stride,
          stride * static_cast<std::size_t>(rows - 1) + static_cast<std::size_t>(pixel * columns)};
}

stgs_image memory_of(const Picture& picture, const stgs_view& view) {
  stgs_image out;
  stgs_image_defaults(&out, sizeof out);
  const py::ssize_t rows = view.height, columns = view.width;
  out.rgba8 = buffer_of<std::uint8_t>(picture.rgba8, "rgba8", rows, columns, 4);
  out.alpha = buffer_of<float>(picture.alpha, "alpha", rows, columns, 1);
  out.depth = buffer_of<float>(picture.depth, "depth", rows, columns, 1);
  if (!picture.rgb.is_none()) {
    if (py::len(picture.rgb) != 3)
      throw py::value_error("rgb: not of the shape (3, rows, columns)");
    for (int c = 0; c < 3; ++c) {
      out.rgb[c] = buffer_of<float>(picture.rgb[py::int_(c)], "rgb", rows, columns, 1);
    }
  }
  return out;
}

Picture new_picture(const std::vector<std::string>& wanted, const stgs_view& view) {
  const py::ssize_t rows = view.height, columns = view.width;
  Picture out;
  for (const std::string& name : wanted) {
    if (name == "rgba8") {
      out.rgba8 = py::array_t<std::uint8_t>({rows, columns, py::ssize_t{4}});
    } else if (name == "rgb") {
      out.rgb = py::array_t<float>({py::ssize_t{3}, rows, columns});
    } else if (name == "alpha") {
      out.alpha = py::array_t<float>({rows, columns});
    } else if (name == "depth") {
      out.depth = py::array_t<float>({rows, columns});
    } else {
      throw py::value_error("a picture has no '" + name + "'; it has rgba8, rgb, alpha and depth");
    }
  }
  return out;
}

// The pictures of the views: those of `out`, else new ones.
py::object render(Renderer& renderer, Scene& scene, double seconds, const py::object& views,
                  const std::vector<std::string>& wanted, const py::object& out) {
  const bool one = py::isinstance<View>(views);
  std::vector<stgs_view> cameras;
  std::vector<Picture> pictures;
  std::vector<stgs_image> memory;
  if (one) {
    cameras.push_back(views.cast<View&>().view);
    if (!out.is_none()) pictures.push_back(out.cast<Picture>());
  } else {
    for (const View& view : views.cast<std::vector<View>>()) cameras.push_back(view.view);
    if (!out.is_none()) pictures = out.cast<std::vector<Picture>>();
  }
  if (!out.is_none() && pictures.size() != cameras.size())
    throw py::value_error("out: not as many pictures as views");
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (out.is_none()) {
      const stgs_view& view = cameras[i];
      if (view.width < 1 || view.height < 1 || view.width > STGS_MAX_SIDE ||
          view.height > STGS_MAX_SIDE) {
        throw Failure(STGS_ERROR_ARGUMENT, "a view's sides are 1 to 32768 pixels");
      }
      pictures.push_back(new_picture(wanted, view));
    }
    memory.push_back(memory_of(pictures[i], cameras[i]));
  }
  renderer.render(scene, seconds, cameras, memory);
  return one ? py::cast(pictures.front()) : py::cast(pictures);
}

// A numpy array of a view's own memory, which `self` keeps alive.
template <std::size_t N>
py::array array_of(const py::object& self, float (&values)[N], std::vector<py::ssize_t> shape) {
  return py::array_t<float>(std::move(shape), values, self);
}

void declare_view(py::module_& module) {
  const auto field = [](auto member) {
    return std::pair{
        [member](const View& v) { return v.view.*member; },
        [member](View& v, std::decay_t<decltype(stgs_view{}.*member)> x) { v.view.*member = x; }};
  };
  py::class_<View> view(module, "View",
                        "A pinhole camera: p_camera = rotation p_world + translation. Arrays are "
                        "the view's own memory: write into them.");
  view.def(py::init([] {
    View out;
    stgs_view_defaults(&out.view, sizeof out.view);
    return out;
  }));
  const auto property = [&](const char* name, auto member) {
    const auto [get, set] = field(member);
    view.def_property(name, get, set);
  };
  property("fx", &stgs_view::fx);
  property("fy", &stgs_view::fy);
  property("cx", &stgs_view::cx);
  property("cy", &stgs_view::cy);
  property("width", &stgs_view::width);
  property("height", &stgs_view::height);
  property("near_plane", &stgs_view::near_plane);
  property("fovea_x", &stgs_view::fovea_x);
  property("fovea_y", &stgs_view::fovea_y);
  property("fovea_radius", &stgs_view::fovea_radius);
  view.def_property_readonly("rotation", [](const py::object& self) {
    return array_of(self, self.cast<View&>().view.rotation, {3, 3});
  });
  view.def_property_readonly("translation", [](const py::object& self) {
    return array_of(self, self.cast<View&>().view.translation, {3});
  });
  view.def_property_readonly("background", [](const py::object& self) {
    return array_of(self, self.cast<View&>().view.background, {3});
  });
  view.def(
      "resized",
      [](const View& self, std::uint32_t width, std::uint32_t height) {
        View out = self;
        const stgs_result result = stgs_view_resize(&out.view, width, height);
        if (result != STGS_OK) throw Failure(result, "a view cannot be of this size");
        return out;
      },
      py::arg("width"), py::arg("height"),
      "The same camera with pictures of another size; the view angle is kept an axis each.");
  view.def("__copy__", [](const View& self) { return self; });
}

}  // namespace

void declare_pictures(py::module_& module) {
  declare_view(module);
  py::class_<Picture>(module, "Picture",
                      "Numpy arrays that are drawn into, or None: rgba8 (rows, columns, 4) of "
                      "bytes; rgb (3, rows, columns), alpha and depth (rows, columns) of floats.")
      .def(py::init([](py::object rgba8, py::object rgb, py::object alpha, py::object depth) {
             return Picture{std::move(rgba8), std::move(rgb), std::move(alpha), std::move(depth)};
           }),
           py::kw_only(), py::arg("rgba8") = py::none(), py::arg("rgb") = py::none(),
           py::arg("alpha") = py::none(), py::arg("depth") = py::none())
      .def_readonly("rgba8", &Picture::rgba8)
      .def_readonly("rgb", &Picture::rgb)
      .def_readonly("alpha", &Picture::alpha)
      .def_readonly("depth", &Picture::depth);
  py::class_<Renderer>(module, "Renderer", "Draws scenes. `backend` is auto, cpu, cuda or vulkan.")
      .def(py::init<const std::string&>(), py::arg("backend") = "auto")
      .def_property_readonly("backend", &Renderer::backend)
      .def("render", &render, py::arg("scene"), py::arg("seconds"), py::arg("views"),
           py::arg("wanted") = std::vector<std::string>{"rgba8"}, py::arg("out") = py::none(),
           "Draws a view, or 1 to 4 of them, of a moment: a Picture each with what is wanted. With "
           "`out`, into its arrays, which may be parts of others.");
}

}  // namespace stgs::python
