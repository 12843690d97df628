#pragma once

#include <Eigen/Core>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// A hand on a body: three springs along the axes of the world from its centre of mass to a target,
/// each critically damped for all the mass that moves with the body, so that it drags what hangs on
/// it as well; lighter bodies follow overdamped. Springs are joints of the engine, which holds them
/// at any mass. They have names below kGripPrefix.
inline constexpr char kGripPrefix[] = "hand/";
inline constexpr double kGripFrequency = 2.0;  ///< [Hz], undamped
/// The spring and the damper each have at most the force that accelerates the mass so [m/s²].
inline constexpr double kGripAcceleration = 100.0;

/// The mass of a dynamic body and of all dynamic bodies that joints and contacts connect to it
/// [kg].
double mass_moved_with(const engine::World& world, engine::BodyId body);

/// Moves the target [m], world frame; grips the body where nobody does. What is farther than the
/// force limit lets the springs reach is approached again with each call. Throws
/// std::invalid_argument for a body that is not dynamic or not there, and a target that is not
/// finite.
void drag(engine::World* world, const std::string& body, const Eigen::Vector3d& target);
/// Takes the springs away; nothing where there are none.
void let_go(engine::World* world, const std::string& body);
/// Whether this is the spring of a hand.
bool is_grip(const engine::Joint& joint);
bool is_gripped(const engine::World& world, const std::string& body);
/// Where the springs pull a body that is gripped [m].
Eigen::Vector3d gripped_target(const engine::World& world, const std::string& body);

}  // namespace constraint_sim
