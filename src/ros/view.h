#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/world.h"
#include "ros/marker_style.h"

namespace constraint_sim {

/// An orbit view of rviz.
struct View {
  Eigen::Vector3d focal_point{0.0, 0.0, 1.2};  ///< [m], world frame
  double distance = 6.5;                       ///< distance of eye and focal point [m]
  double pitch = 0.45, yaw = 1.1;              ///< [rad]
};

/// Returns the extent of a world in its first three seconds [m], bounded by the first extent
/// enlarged by its diagonal on each side: falling bodies would enlarge it without end.
Extent seen_extent(engine::World world);
/// Returns a view that shows all of `extent`, as large as possible; the default for a point or an
/// empty extent.
View fitted_view(const Extent& extent);

}  // namespace constraint_sim
