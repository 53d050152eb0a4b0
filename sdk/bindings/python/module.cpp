// SPDX-License-Identifier: Apache-2.0
#include "classes.h"

namespace stgs::python {
namespace {

// Raises stgs.Error for a Failure.
void translate(const py::object& type, const Failure& failure) {
  py::object error = type(std::string(failure.what()));
  error.attr("code") = failure.code;
  error.attr("name") = stgs_result_name(failure.code);
  error.attr("issue") = failure.issue;
  error.attr("offset") = failure.offset ? py::object(py::int_(*failure.offset)) : py::none();
  PyErr_SetObject(type.ptr(), error.ptr());
}

}  // namespace
}  // namespace stgs::python

PYBIND11_MODULE(stgs, module) {
  using namespace stgs::python;
  module.doc() =
      "Opens, plays and renders .stgs scenes. Images and primitives are NumPy arrays. Calls "
      "release "
      "the GIL; threads that share an object wait for each other. The log of the library goes to "
      "logging.getLogger('stgs').";
  const std::uint32_t version = stgs_version();
  module.attr("__version__") = std::to_string(version / 1000000) + "." +
                               std::to_string(version / 1000 % 1000) + "." +
                               std::to_string(version % 1000);
  const py::object created = py::reinterpret_steal<py::object>(PyErr_NewExceptionWithDoc(
      "stgs.Error",
      "A failed call. Attributes: code and name of the result (see stgs.h), offset (position in "
      "the "
      "file in bytes, or None) and issue (number as in `stgs validate`, or 0).",
      PyExc_RuntimeError, nullptr));
  if (!created) throw py::error_already_set();
  module.attr("Error") = created;
  // Never released: it must outlive the module.
  static PyObject* const error = created.inc_ref().ptr();
  // NOLINTNEXTLINE(performance-unnecessary-value-param): the type that pybind11 requires
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Failure& failure) {
      translate(py::reinterpret_borrow<py::object>(error), failure);
    }
  });
  declare_view(module);
  declare_scene(module);
  declare_renderer(module);
  declare_player(module);
}
