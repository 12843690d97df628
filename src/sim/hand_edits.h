#pragma once

#include <Eigen/Core>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

// Actions of the menu of a body. Bad input throws std::invalid_argument and changes nothing.

/// Holds a body in place by a weld to the world, or a point mass by a ball joint, named
/// `fixed/BODY`.
void fix(engine::World* world, const std::string& body);
/// Removes that joint, and the springs of a hand.
void release(engine::World* world, const std::string& body);
/// Adds `by` to the body's velocity [m/s], in the world's axes, by a force on this body during 0.1
/// s.
void push(engine::World* world, const std::string& body, const Eigen::Vector3d& by);
/// Adds a rod named `joined/A/B` between the centres of mass, as long as their present distance.
void join(engine::World* world, const std::string& a, const std::string& b);

}  // namespace constraint_sim
