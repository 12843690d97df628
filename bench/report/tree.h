#pragma once

// Joint coordinates: a problem's bodies as a tree, for engines that have them.

#include "contestant.h"

namespace constraint_sim::report {

/// A body hung on another. Its frame is the joint's: at the joint, axes along the body's own.
struct Link {
  int body;
  int parent;              ///< kWorld, or a body that comes before in the list
  bool is_hung;            ///< on a joint or rod; else it is free
  Eigen::Vector3d anchor;  ///< joint, in the parent's body frame about its centre, or world [m]
  Eigen::Vector3d centre;  ///< centre of mass from the joint, in the body's frame [m]
  const Joint* joint = nullptr;  ///< that it hangs on, where it has axes: then A is the parent
};

/// Parents before their children. Throws Unsupported where joint coordinates of ball joints cannot
/// express the problem: springs, motors, joints with axes whose bodies move at the start, rods
/// between bodies that rotate, and loops, unless the joints that close them are asked for.
std::vector<Link> tree_of(const Problem& problem, std::vector<Joint>* loops = nullptr);

/// The moments of inertia of a body; of a point mass as small ones as change nothing that can be
/// seen, since engines in joint coordinates divide by them.
Eigen::Vector3d inertia_of(const Body& body);

/// Angular velocity that the frame of a link starts with [rad/s], world axes: of a point mass on a
/// rod what its velocity tells.
Eigen::Vector3d start_spin(const Problem& problem, const Link& link);

}  // namespace constraint_sim::report
