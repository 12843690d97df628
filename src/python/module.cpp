// The Python module constraint_sim.engine. Its stubs, with all types, are
// python/constraint_sim/engine.pyi.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "python/definitions.h"
#include "python/parameters.h"

namespace constraint_sim::python {
namespace {

PyObject* make_instance(PyTypeObject* type, PyObject* /*arguments*/, PyObject* /*keywords*/) {
  return py::detail::make_new_instance(type);
}

engine::WorldOptions defaults_from(const py::kwargs& keywords) {
  engine::WorldOptions defaults;
  options_from(frozen(keywords), &defaults);
  return defaults;
}

void define_scenes(py::module* module) {
  module->def(
      "load_scene",
      [](const std::string& text, const std::string& source, const py::kwargs& defaults) {
        return std::make_unique<SharedWorld>(
            engine::load_scene(text, source, defaults_from(defaults)));
      },
      py::arg("text"), py::arg("source") = "scene",
      "load_scene(text, source='scene', **defaults)\n\nWorld of a scene in YAML (docs/scenes.md). "
      "`source` names it in errors; `defaults` are options that hold where the scene sets none. "
      "Raises SceneError, a ValueError, with line, key and value.");
  module->def(
      "load_scene_file",
      [](const std::string& path, const py::kwargs& defaults) {
        return std::make_unique<SharedWorld>(
            engine::load_scene_file(path, defaults_from(defaults)));
      },
      py::arg("path"),
      "load_scene_file(path, **defaults)\n\nWorld of a scene in a file, as load_scene.");
}

}  // namespace

// Disables `__new__`. Python lets `__new__` of a base class make an object only where the class has
// the same function.
void make_by_call_alone(py::handle type) {
  reinterpret_cast<PyTypeObject*>(type.ptr())->tp_new = make_instance;
}

}  // namespace constraint_sim::python

PYBIND11_MODULE(engine, module) {
  namespace py = pybind11;
  using namespace constraint_sim::python;
  py::options options;
  options.disable_function_signatures();  // docstrings contain signatures with units
  module.doc() =
      "The engine of constraint_sim: worlds of rigid bodies, stepped without ROS.\n\n"
      "All quantities are in SI units, vectors in world axes, quaternions as x y z w. "
      "docs/python.md is the manual.";
  module.attr("__version__") = CONSTRAINT_SIM_VERSION;
  py::list methods;
  for (std::size_t i = 0; i < constraint_sim::engine::kMethodCount; ++i)
    methods.append(constraint_sim::engine::name(static_cast<constraint_sim::engine::Method>(i)));
  module.attr("METHODS") = py::tuple(methods);
  py::register_exception<constraint_sim::engine::SceneError>(module, "SceneError",
                                                             PyExc_ValueError);
  // Loads numpy's functions once: two threads that load them later would block each other.
  py::dtype::of<double>();
  define_shapes(&module);
  define_reports(&module);
  define_world(&module);
  define_verify(&module);
  define_scenes(&module);
}
