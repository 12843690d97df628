#pragma once

#include <pybind11/pybind11.h>

#include <string>

#include "constraint_sim/engine/world.h"
#include "python/keywords.h"

namespace constraint_sim::python {

// Parameters of worlds, bodies, joints and motors between C++ structs and the keywords of Python.
// Each `*_from` keeps in `target` what the keywords do not name; each `*_dict` gives keywords from
// which `*_from` makes the same struct.

void options_from(const py::dict& keywords, engine::WorldOptions* target);
py::dict options_dict(const engine::WorldOptions& options);

void body_from(const py::dict& keywords, engine::Body* target);
py::dict body_dict(const engine::Body& body);

void state_from(const py::dict& keywords, engine::BodyState* target);
py::dict state_dict(const engine::BodyState& state);

void motor_from(const py::dict& keywords, engine::Motor* target);
py::dict motor_dict(const engine::Motor& motor);
void motor_from(const py::dict& keywords, engine::CoordinateMotor* target);
py::dict motor_dict(const engine::CoordinateMotor& motor);

/// Bodies are looked up in `world`. `broken`: whether the joint starts broken.
engine::Joint joint_from(const py::dict& keywords, const engine::World& world, bool* broken);
/// Sets what is named, of what can change while the joint acts, and keeps the rest.
void change_joint(const py::dict& keywords, engine::Joint* joint);
py::dict joint_dict(const engine::Joint& joint, const engine::World& world, bool broken);

/// Name of a body; "world" is the world itself.
std::string body_name(const engine::World& world, engine::BodyId id);

py::tuple tuple_of(const Eigen::Vector3d& vector);

}  // namespace constraint_sim::python
