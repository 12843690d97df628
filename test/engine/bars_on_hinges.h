#pragma once

// Bars along x, each hinged to the one before it, with axes y and z in turn.

#include <string>
#include <vector>

#include "support.h"

namespace constraint_sim::engine {

/// One bar per mass [kg], of the given length [m], with dampers [N m s/rad].
inline World bars_on_hinges(const WorldOptions& options, const std::vector<double>& masses,
                            double length = 1.0, double damping = 0.0) {
  using Eigen::Vector3d;
  World world(options);
  BodyId before = kWorldBody;
  for (std::size_t i = 0; i < masses.size(); ++i) {
    Body bar = make_body("bar_" + std::to_string(i), Box{length * Vector3d(0.9, 0.1, 0.1)},
                         masses[i], Vector3d((static_cast<double>(i) + 0.5) * length, 0.0, 0.0));
    bar.no_collision = true;
    Joint hinge;
    hinge.name = "hinge_" + std::to_string(i);
    hinge.kind = JointKind::kHinge;
    hinge.body_a = before;
    if (i > 0) hinge.anchor_a = {0.5 * length, 0.0, 0.0};
    hinge.anchor_b = {-0.5 * length, 0.0, 0.0};
    hinge.frame_a = frame_along(i % 2 == 0 ? Vector3d::UnitY() : Vector3d::UnitZ());
    hinge.coordinates[0].damping = damping;
    hinge.body_b = before = world.add_body(bar);
    world.add_joint(hinge);
  }
  return world;
}

}  // namespace constraint_sim::engine
