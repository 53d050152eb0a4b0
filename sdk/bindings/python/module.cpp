// SPDX-License-Identifier: Apache-2.0
#include "classes.h"

namespace stgs::python {
namespace {

// Makes stgs.Error of a Failure.
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
      "Opens and plays .stgs scenes and draws them into numpy arrays. Calls do not hold the "
      "interpreter's "
      "lock; objects may be used by several threads, which then wait for each other. The library's "
      "log goes to logging.getLogger('stgs').";
  const std::uint32_t version = stgs_version();
  module.attr("__version__") = std::to_string(version / 1000000) + "." +
                               std::to_string(version / 1000 % 1000) + "." +
                               std::to_string(version % 1000);
  const py::object made = py::reinterpret_steal<py::object>(PyErr_NewExceptionWithDoc(
      "stgs.Error",
      "What a call on a scene, player or renderer failed with: code and name of the result "
      "(stgs.h), "
      "offset (byte of the file, or None) and issue (as `stgs validate` numbers it, or 0).",
      PyExc_RuntimeError, nullptr));
  if (!made) throw py::error_already_set();
  module.attr("Error") = made;
  // As long as the interpreter, whatever happens to the module.
  static PyObject* const error = made.inc_ref().ptr();
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Failure& failure) {
      translate(py::reinterpret_borrow<py::object>(error), failure);
    }
  });
  declare_scene(module);
  declare_pictures(module);
  declare_player(module);
}
