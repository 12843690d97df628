#pragma once

#include <Eigen/Core>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

// What the menu of a body does. Bad input throws std::invalid_argument and changes nothing.

/// Holds the body where it is by a weld to the world, of a point mass a ball joint, named
/// `fixed/BODY`.
void fix(engine::World* world, const std::string& body);
/// Takes that away, and what drags the body.
void release(engine::World* world, const std::string& body);
/// Makes the body faster by this [m/s], world axes, within 0.1 s by a force on it alone.
void push(engine::World* world, const std::string& body, const Eigen::Vector3d& by);
/// A rod named `joined/A/B` between the centres of mass, as long as their distance now.
void join(engine::World* world, const std::string& a, const std::string& b);

}  // namespace constraint_sim
