#pragma once

// Joint coordinates: a problem's bodies as a tree, for engines that have them.

#include "contestant.h"

namespace constraint_sim::report {

/// A body hung on another one. Its frame is at the joint, with axes along the body's own.
struct Link {
  int body;
  int parent;              ///< kWorld, or a body earlier in the list
  bool is_hung;            ///< on a joint or rod; else it is free
  Eigen::Vector3d anchor;  ///< joint, in the parent's body frame about its centre, or world [m]
  Eigen::Vector3d centre;  ///< centre of mass from the joint, in the body's frame [m]
  const Joint* joint =
      nullptr;  ///< joint with axes that the link hangs on, with A as the parent; else nullptr
  double rate = 0.0;  ///< initial rate of the coordinate of a hinge or slider
};

/// Returns links, parents before children. Throws Unsupported where joint coordinates cannot
/// express the problem: springs unless left out, motors of rods, joints with axes whose bodies move
/// at the start except hinges and sliders on the world, rods between rotating bodies, and loops
/// unless `loops` is given. Free lengths are left out; laws along coordinates are left to the
/// caller.
std::vector<Link> tree_of(const Problem& problem, std::vector<Joint>* loops = nullptr,
                          bool leaves_out_springs = false);

/// Returns the moments of inertia of a body. A point mass gets negligibly small ones, since engines
/// in joint coordinates divide by them.
Eigen::Vector3d inertia_of(const Problem& problem, const Body& body);

/// Returns the initial angular velocity of a link's frame [rad/s], world axes; for a point mass on
/// a rod that of the rod.
Eigen::Vector3d start_spin(const Problem& problem, const Link& link);

}  // namespace constraint_sim::report
