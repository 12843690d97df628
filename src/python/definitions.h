#pragma once

#include <pybind11/pybind11.h>

#include <cmath>
#include <memory>
#include <optional>

#include "python/shared_world.h"

namespace constraint_sim::python {

// Classes of the module, one file of definitions each.

void define_shapes(py::module* module);
void define_reports(py::module* module);  ///< StepReport and RunReport
void define_world(py::module* module);
void define_verify(py::module* module);  ///< VerifyReport and verify()

/// Makes `__new__` of this class raise TypeError: it would give an object without `__init__`, whose
/// memory nobody has set.
void make_by_call_alone(py::handle type);

using WorldClass = py::class_<SharedWorld>;
void define_joints(WorldClass* world);
void define_verify(WorldClass* world);

/// An estimate; None where there is none, which the engine has as NaN.
inline std::optional<double> known(double estimate) {
  return std::isnan(estimate) ? std::nullopt : std::optional(estimate);
}

}  // namespace constraint_sim::python
