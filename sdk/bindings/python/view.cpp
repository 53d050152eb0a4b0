// SPDX-License-Identifier: Apache-2.0
// Views.
#include <pybind11/stl.h>

#include <array>

#include "classes.h"

namespace stgs::python {
namespace {

// Returns a NumPy array that refers to memory of a view; `self` owns the memory.
template <std::size_t N>
py::array array_of(const py::object& self, float (&values)[N], std::vector<py::ssize_t> shape) {
  return py::array_t<float>(std::move(shape), values, self);
}

std::string repr_of(const View& view) {
  const stgs_view& v = view.view;
  double at[3] = {0, 0, 0};
  for (int row = 0; row < 3; ++row) {
    for (int i = 0; i < 3; ++i) at[i] -= double{v.rotation[3 * row + i]} * v.translation[row];
  }
  return format("<stgs.View {}x{}, fx {:.5g}, fy {:.5g}, at ({:.4g}, {:.4g}, {:.4g})>", v.width,
                v.height, v.fx, v.fy, at[0] + 0.0, at[1] + 0.0, at[2] + 0.0);
}

}  // namespace

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
  view.def("__repr__", &repr_of);
}

}  // namespace stgs::python
