#pragma once

#include <pybind11/pybind11.h>

#include <cmath>
#include <memory>
#include <optional>

#include "python/shared_world.h"

namespace constraint_sim::python {

// Definitions of the module's classes, one file each.

void define_shapes(py::module* module);
void define_reports(py::module* module);  ///< StepReport and RunReport
void define_world(py::module* module);
void define_verify(py::module* module);  ///< VerifyReport and verify()

/// Makes `__new__` of a class raise TypeError: it would return an object without `__init__`, with
/// uninitialized memory.
void make_by_call_alone(py::handle type);

using WorldClass = py::class_<SharedWorld>;
void define_geometry(WorldClass* world);
void define_joints(WorldClass* world);
void define_robots(WorldClass* world);
void define_verify(WorldClass* world);
/// RobotDynamics and World.robot_dynamics.
void define_robot_dynamics(py::module* module, WorldClass* world);

/// Returns an estimate; None for NaN, which means that there is no estimate.
inline std::optional<double> known(double estimate) {
  return std::isnan(estimate) ? std::nullopt : std::optional(estimate);
}

}  // namespace constraint_sim::python
