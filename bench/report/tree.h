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
  double rate = 0.0;  ///< of its coordinate at the start, where that is a hinge or slider
};

/// Parents before their children. Throws Unsupported where joint coordinates of ball joints cannot
/// express the problem: springs, unless they are to be left out, motors of rods, joints with axes
/// whose bodies move at the start but for hinges and sliders on the world, rods between bodies that
/// rotate, and loops, unless the joints that close them are asked for. Free lengths are left out,
/// and what acts along coordinates is for the caller.
std::vector<Link> tree_of(const Problem& problem, std::vector<Joint>* loops = nullptr,
                          bool leaves_out_springs = false);

/// The moments of inertia of a body; of a point mass as small ones as change nothing that can be
/// seen, since engines in joint coordinates divide by them.
Eigen::Vector3d inertia_of(const Body& body);

/// Angular velocity that the frame of a link starts with [rad/s], world axes: of a point mass on a
/// rod what its velocity tells.
Eigen::Vector3d start_spin(const Problem& problem, const Link& link);

}  // namespace constraint_sim::report
