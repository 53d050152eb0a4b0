// SPDX-License-Identifier: Apache-2.0
// Images and renderers.
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
  explicit Renderer(const std::string& backend)
      : log_(std::make_shared<Log>()), handle_("renderer", log_) {
    stgs_renderer_settings settings;
    stgs_renderer_settings_defaults(&settings, sizeof settings);
    settings.backend = backend_of(backend);
    settings.log = Log::append;
    settings.log_user = log_.get();
    stgs_renderer* created = nullptr;
    const auto create = [&] {
      const py::gil_scoped_release release;
      return stgs_renderer_create(&settings, &created);
    };
    const stgs_result result = create();
    log_->flush();
    if (result != STGS_OK)
      throw Failure(result, "cannot create a renderer for backend '" + backend + "'");
    handle_.set(created);
  }

  std::string backend() {
    stgs_backend backend = STGS_BACKEND_AUTO;
    handle_.run([&](stgs_renderer* r) { return stgs_renderer_get_backend(r, &backend); });
    return kBackends.at(static_cast<std::size_t>(backend));
  }

  void render(Scene& scene, double seconds, const std::vector<stgs_view>& views,
              const std::vector<stgs_image>& images) {
    handle_.run(
        [&](stgs_renderer* r, stgs_scene* s) {
          return stgs_render(r, s, seconds, views.data(), images.data(),
                             static_cast<std::uint32_t>(views.size()));
        },
        scene.handle());
  }

  void close() { handle_.close(); }
  bool is_closed() { return handle_.is_closed(); }

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
  std::shared_ptr<Log> log_;
  RendererHandle handle_;
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

std::string type_of(const py::handle& object) {
  return py::str(py::type::handle_of(object).attr("__name__"));
}

// Returns the elements of an argument that is a T or a sequence of T. Throws TypeError otherwise;
// `expected` describes the argument.
template <typename T>
std::vector<T> elements_of(const py::object& argument, const char* expected) {
  std::vector<T> out;
  if (py::isinstance<T>(argument)) {
    out.push_back(argument.cast<T>());
    return out;
  }
  if (!py::isinstance<py::sequence>(argument))
    throw py::type_error(std::string(expected) + ", not " + type_of(argument));
  for (const py::handle element : argument.cast<py::sequence>()) {
    if (!py::isinstance<T>(element)) {
      throw py::type_error(std::string(expected) + ", not a " + type_of(argument) +
                           " that contains " + type_of(element));
    }
    out.push_back(element.cast<T>());
  }
  return out;
}

// Returns the images of the views: `out`, or new ones.
py::object render(Renderer& renderer, Scene& scene, double seconds, const py::object& views,
                  const std::vector<std::string>& buffers, const py::object& out) {
  std::vector<stgs_view> cameras;
  for (const View& one :
       elements_of<View>(views, "views must be a stgs.View or a sequence of them"))
    cameras.push_back(one.view);
  std::vector<Image> images;
  if (!out.is_none()) {
    images = elements_of<Image>(out, "out must be a stgs.Image or a sequence of them");
    if (images.size() != cameras.size())
      throw py::value_error("out: the numbers of images and views differ");
  }
  std::vector<stgs_image> memory;
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
  return py::isinstance<View>(views) ? py::cast(images.front()) : py::cast(images);
}

std::string repr_of_image(const Image& image) {
  std::string out = "<stgs.Image";
  const std::pair<const char*, const py::object&> buffers[] = {
      {"rgba8", image.rgba8}, {"rgb", image.rgb}, {"alpha", image.alpha}, {"depth", image.depth}};
  const char* separator = " ";
  for (const auto& [name, array] : buffers) {
    if (array.is_none()) continue;
    out += separator + format("{} {}", name, py::getattr(array, "shape", py::str("?")));
    separator = ", ";
  }
  return out + ">";
}

std::string repr_of_renderer(Renderer& renderer) {
  return renderer.is_closed() ? std::string("<stgs.Renderer, closed>")
                              : format("<stgs.Renderer {!r}>", renderer.backend());
}

}  // namespace

void declare_renderer(py::module_& module) {
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
      .def_readonly("depth", &Image::depth)
      .def("__repr__", &repr_of_image);
  py::class_<Renderer> renderer(module, "Renderer",
                                "Renders scenes. `backend` is auto, cpu, cuda or vulkan. A context "
                                "manager, which closes it.");
  add_closing(renderer, "Releases the backend and its memory.");
  renderer.def(py::init<const std::string&>(), py::arg("backend") = "auto")
      .def_property_readonly("backend", &Renderer::backend)
      .def(
          "render", &render, py::arg("scene"), py::arg("seconds"), py::arg("views"),
          py::arg("buffers") = std::vector<std::string>{"rgba8"}, py::arg("out") = py::none(),
          "Renders a view, or a list of 1 to 4 views, at one time and returns an Image, or a list, "
          "with the requested buffers. `out` provides the arrays instead; they may be slices.")
      .def("__repr__", &repr_of_renderer);
}

}  // namespace stgs::python
