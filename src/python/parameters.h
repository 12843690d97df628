#pragma once

#include <pybind11/pybind11.h>

#include <optional>
#include <string>

#include "constraint_sim/engine/world.h"
#include "python/keywords.h"

namespace constraint_sim::python {

// Conversion of worlds, bodies, joints and motors between C++ structs and Python keywords. Each
// `*_from` keeps fields in `target` that have no keyword; each `*_dict` gives keywords that
// `*_from` converts back to the same struct.

void options_from(const py::dict& keywords, engine::WorldOptions* target);
py::dict options_dict(const engine::WorldOptions& options);

/// Returns a shape of a class of this module.
engine::Shape shape_from(const py::object& value);
/// Returns a pose from a dict of position and orientation; none from None.
std::optional<engine::ShapePose> shape_pose_from(const py::object& value);
py::dict shape_pose_dict(const engine::ShapePose& pose);

void body_from(const py::dict& keywords, engine::Body* target);
py::dict body_dict(const engine::Body& body);

void state_from(const py::dict& keywords, engine::BodyState* target);
py::dict state_dict(const engine::BodyState& state);

void motor_from(const py::dict& keywords, engine::Motor* target);
/// Reads the motor of a length, which has the keywords of a velocity motor alone.
void velocity_motor_from(const py::dict& keywords, engine::Motor* target);

/// Reads a joint between bodies of `world`. `broken`: whether the joint starts broken.
engine::Joint joint_from(const py::dict& keywords, const engine::World& world, bool* broken);
/// Changes settings of an existing joint that have a keyword, and keeps the others.
void change_joint(const py::dict& keywords, engine::Joint* joint);
py::dict joint_dict(const engine::Joint& joint, const engine::World& world, bool broken);

/// Returns the name of a body; "world" for the world itself.
std::string body_name(const engine::World& world, engine::BodyId id);

py::tuple tuple_of(const Eigen::Vector3d& vector);

}  // namespace constraint_sim::python
