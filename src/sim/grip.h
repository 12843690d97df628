#pragma once

#include <Eigen/Core>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// A hand on a body: three springs along the axes of the world, from its centre of mass to a
/// target. Each is critically damped for the mass of all bodies that move along; lighter bodies
/// follow overdamped. The springs are joints of the engine, stable at any mass, with names below
/// kGripPrefix.
inline constexpr char kGripPrefix[] = "hand/";
inline constexpr double kGripFrequency = 2.0;  ///< undamped frequency [Hz]
/// Force limit of spring and damper over the mass that moves along [m/s²].
inline constexpr double kGripAcceleration = 100.0;

/// Returns the mass of a dynamic body and of all dynamic bodies connected to it by joints and
/// contacts [kg].
double mass_moved_with(const engine::World& world, engine::BodyId body);

/// Moves the target [m], in the world's frame; grips the body first if necessary. A target beyond
/// the reach of the force limit is approached with each call. Throws std::invalid_argument for a
/// body that is missing or not dynamic, and for a target that is not finite.
void drag(engine::World* world, const std::string& body, const Eigen::Vector3d& target);
/// Removes the springs, if any.
void let_go(engine::World* world, const std::string& body);
/// Returns whether a joint is the spring of a hand.
bool is_grip(const engine::Joint& joint);
bool is_gripped(const engine::World& world, const std::string& body);
/// Returns the target of a gripped body [m].
Eigen::Vector3d gripped_target(const engine::World& world, const std::string& body);

}  // namespace constraint_sim
