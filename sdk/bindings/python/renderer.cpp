// SPDX-License-Identifier: Apache-2.0
// Views, images and renderers.
#include <pybind11/stl.h>

#include <array>

#include "classes.h"

namespace stgs::python {
namespace {

// NumPy arrays that receive an image; None: not requested.
struct Image {
  py::object rgba8 = py::none(), rgb = py::none(), alpha = py::none(), depth = py::none();
};

class Renderer {
 public:
  explicit Renderer(const std::string& backend) {
    stgs_renderer_settings settings;
    stgs_renderer_settings_defaults(&settings, sizeof settings);
    settings.backend = backend_of(backend);
    settings.log = Log::append;
    settings.log_user = &log_;
    stgs_renderer* created = nullptr;
    std::string message;
    const stgs_result result =
        unlocked([&] { return stgs_renderer_create(&settings, &created); }, mutex_);
    log_.flush();
    if (result != STGS_OK)
      throw Failure(result, "cannot create a renderer for backend '" + backend + "'");
    renderer_.reset(created);
  }

  std::string backend() {
    stgs_backend backend = STGS_BACKEND_AUTO;
    const stgs_result result =
        unlocked([&] { return stgs_renderer_get_backend(renderer_.get(), &backend); }, mutex_);
    check(result, static_cast<const stgs_renderer*>(renderer_.get()), stgs_renderer_error);
    return kBackends.at(static_cast<std::size_t>(backend));
  }

  void render(Scene& scene, double seconds, const std::vector<stgs_view>& views,
              const std::vector<stgs_image>& images) {
    const stgs_result result = unlocked(
        [&] {
          return stgs_render(renderer_.get(), scene.get(), seconds, views.data(), images.data(),
                             static_cast<std::uint32_t>(views.size()));
        },
        mutex_, scene.mutex());
    log_.flush();
    scene.log().flush();
    check(result, static_cast<const stgs_renderer*>(renderer_.get()), stgs_renderer_error);
  }

 private:
  // Index: stgs_backend.
  static constexpr std::array<const char*, 4> kBackends = {"auto", "cpu", "cuda", "vulkan"};
  static stgs_backend backend_of(const std::string& name) {
    for (std::size_t i = 0; i < kBackends.size(); ++i) {
      if (name == kBackends[i]) return static_cast<stgs_backend>(i);
    }
    throw Failure(STGS_ERROR_ARGUMENT,
                  "unknown backend '" + name + "' (expected auto, cpu, cuda or vulkan)");
  }
  struct Destroy {
    void operator()(stgs_renderer* renderer) const { stgs_renderer_destroy(renderer); }
  };
  Log log_;
  std::mutex mutex_;
  std::unique_ptr<stgs_renderer, Destroy> renderer_;
};

// Returns the memory of an array of `rows` x `columns` pixels of `channels` elements. Rows may be
// padded. Throws ValueError unless the array matches.
template <typename T>
stgs_buffer buffer_of(const py::object& object, const char* name, py::ssize_t rows,
                      py::ssize_t columns, py::ssize_t channels) {
  if (object.is_none()) return {};
  const auto mismatch = [&](const std::string& why) {
    return py::value_error(std::string(name) + ": " + why);
  };
  if (!py::isinstance<py::array_t<T>>(object))
    throw mismatch("expected a NumPy array of " + std::string(py::str(py::dtype::of<T>())));
  auto array = py::reinterpret_borrow<py::array>(object);
  const bool flat = array.ndim() == 2 && channels == 1;
  if (!flat && !(array.ndim() == 3 && array.shape(2) == channels))
    throw mismatch("the array has the wrong shape");
  if (array.shape(0) != rows || array.shape(1) != columns)
    throw mismatch("the array and the view differ in size");
  if (!array.writeable()) throw mismatch("the array is not writeable");
  const auto pixel = static_cast<py::ssize_t>(sizeof(T)) * channels;
  const bool dense = array.strides(1) == pixel &&
                     (flat || array.strides(2) == static_cast<py::ssize_t>(sizeof(T)));
  if (!dense || array.strides(0) < pixel * columns)
    throw mismatch("the pixels of a row must be contiguous");
  const auto stride = static_cast<std::size_t>(array.strides(0));
  return {array.mutable_data(), stride,
          stride * static_cast<std::size_t>(rows - 1) + static_cast<std::size_t>(pixel * columns)};
}

stgs_image memory_of(const Image& image, const stgs_view& view) {
  stgs_image out;
  stgs_image_defaults(&out, sizeof out);
  const py::ssize_t rows = view.height, columns = view.width;
  out.rgba8 = buffer_of<std::uint8_t>(image.rgba8, "rgba8", rows, columns, 4);
  out.alpha = buffer_of<float>(image.alpha, "alpha", rows, columns, 1);
  out.depth = buffer_of<float>(image.depth, "depth", rows, columns, 1);
  if (!image.rgb.is_none()) {
    if (py::len(image.rgb) != 3) throw py::value_error("rgb: expected shape (3, rows, columns)");
    for (int c = 0; c < 3; ++c) {
      out.rgb[c] = buffer_of<float>(image.rgb[py::int_(c)], "rgb", rows, columns, 1);
    }
  }
  return out;
}

Image new_image(const std::vector<std::string>& buffers, const stgs_view& view) {
  const py::ssize_t rows = view.height, columns = view.width;
  Image out;
  for (const std::string& name : buffers) {
    if (name == "rgba8") {
      out.rgba8 = py::array_t<std::uint8_t>({rows, columns, py::ssize_t{4}});
    } else if (name == "rgb") {
      out.rgb = py::array_t<float>({py::ssize_t{3}, rows, columns});
    } else if (name == "alpha") {
      out.alpha = py::array_t<float>({rows, columns});
    } else if (name == "depth") {
      out.depth = py::array_t<float>({rows, columns});
    } else {
      throw py::value_error("unknown buffer '" + name + "' (expected rgba8, rgb, alpha or depth)");
    }
  }
  return out;
}

// Returns the images of the views: `out`, or new ones.
py::object render(Renderer& renderer, Scene& scene, double seconds, const py::object& views,
                  const std::vector<std::string>& buffers, const py::object& out) {
  const bool one = py::isinstance<View>(views);
  std::vector<stgs_view> cameras;
  std::vector<Image> images;
  std::vector<stgs_image> memory;
  if (one) {
    cameras.push_back(views.cast<View&>().view);
    if (!out.is_none()) images.push_back(out.cast<Image>());
  } else {
    for (const View& view : views.cast<std::vector<View>>()) cameras.push_back(view.view);
    if (!out.is_none()) images = out.cast<std::vector<Image>>();
  }
  if (!out.is_none() && images.size() != cameras.size())
    throw py::value_error("out: the numbers of images and views differ");
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (out.is_none()) {
      const stgs_view& view = cameras[i];
      if (view.width < 1 || view.height < 1 || view.width > STGS_MAX_SIDE ||
          view.height > STGS_MAX_SIDE) {
        throw Failure(STGS_ERROR_ARGUMENT, "view: width and height must be 1 to 32768 pixels");
      }
      images.push_back(new_image(buffers, view));
    }
    memory.push_back(memory_of(images[i], cameras[i]));
  }
  renderer.render(scene, seconds, cameras, memory);
  return one ? py::cast(images.front()) : py::cast(images);
}

// Returns a NumPy array that refers to memory of a view; `self` owns the memory.
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
                        "A pinhole camera: p_camera = rotation @ p_world + translation. The arrays "
                        "refer to memory of the view: assign to their elements.");
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
        if (result != STGS_OK) throw Failure(result, "view: invalid image size");
        return out;
      },
      py::arg("width"), py::arg("height"),
      "Returns the view with another image size and square pixels: it shows at least what this "
      "view "
      "shows.");
  view.def(
      "stretched",
      [](const View& self, std::uint32_t width, std::uint32_t height) {
        View out = self;
        const stgs_result result = stgs_view_stretch(&out.view, width, height);
        if (result != STGS_OK) throw Failure(result, "view: invalid image size");
        return out;
      },
      py::arg("width"), py::arg("height"),
      "Returns the view with another image size and the same view angles: pixels are stretched.");
  using Vector = std::array<float, 3>;
  view.def(
      "looking_at",
      [](const View& self, const Vector& eye, const Vector& target,
         const std::optional<Vector>& up) {
        View out = self;
        const stgs_result result =
            stgs_view_look_at(&out.view, eye.data(), target.data(), up ? up->data() : nullptr);
        if (result != STGS_OK) {
          throw Failure(result,
                        "looking_at: eye and target coincide, up is parallel to the line "
                        "between them, or a value is invalid");
        }
        return out;
      },
      py::arg("eye"), py::arg("target"), py::arg("up") = py::none(),
      "Returns the view from `eye` to `target`. `up` points against gravity; None or zeros: as in "
      "this view.");
  view.def(
      "orbited",
      [](const View& self, const Vector& centre, double azimuth, double elevation,
         const std::optional<Vector>& up) {
        View out = self;
        const stgs_result result = stgs_view_orbit(&out.view, centre.data(),
                                                   up ? up->data() : nullptr, azimuth, elevation);
        if (result != STGS_OK) {
          throw Failure(result, "orbited: the camera is at the centre, or a value is invalid");
        }
        return out;
      },
      py::arg("centre"), py::arg("azimuth"), py::arg("elevation") = 0.0, py::arg("up") = py::none(),
      "Returns the view, moved around `centre` by `azimuth` radians to its right and `elevation` "
      "radians towards `up`. None or zeros: as in this view.");
  view.def("__copy__", [](const View& self) { return self; });
}

}  // namespace

void declare_images(py::module_& module) {
  declare_view(module);
  py::class_<Image>(module, "Image",
                    "NumPy arrays that receive an image, or None: rgba8 (rows, columns, 4) of "
                    "uint8; rgb (3, rows, columns), alpha and depth (rows, columns) of float32.")
      .def(py::init([](py::object rgba8, py::object rgb, py::object alpha, py::object depth) {
             return Image{std::move(rgba8), std::move(rgb), std::move(alpha), std::move(depth)};
           }),
           py::kw_only(), py::arg("rgba8") = py::none(), py::arg("rgb") = py::none(),
           py::arg("alpha") = py::none(), py::arg("depth") = py::none())
      .def_readonly("rgba8", &Image::rgba8)
      .def_readonly("rgb", &Image::rgb)
      .def_readonly("alpha", &Image::alpha)
      .def_readonly("depth", &Image::depth);
  py::class_<Renderer>(module, "Renderer",
                       "Renders scenes. `backend` is auto, cpu, cuda or vulkan.")
      .def(py::init<const std::string&>(), py::arg("backend") = "auto")
      .def_property_readonly("backend", &Renderer::backend)
      .def(
          "render", &render, py::arg("scene"), py::arg("seconds"), py::arg("views"),
          py::arg("buffers") = std::vector<std::string>{"rgba8"}, py::arg("out") = py::none(),
          "Renders a view, or a list of 1 to 4 views, at one time and returns an Image, or a list, "
          "with the requested buffers. `out` provides the arrays instead; they may be slices.");
}

}  // namespace stgs::python
