#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/world.h"
#include "ros/marker_style.h"

namespace constraint_sim {

/// An orbit view of rviz.
struct View {
  Eigen::Vector3d focal_point{0.0, 0.0, 1.2};  ///< [m], world frame
  double distance = 6.5;                       ///< of the eye from it [m]
  double pitch = 0.45, yaw = 1.1;              ///< [rad]
};

/// What a world covers at first and in its first three seconds [m], as far as that is within what
/// it covers at first and as much again around it: what falls away is not waited for.
Extent seen_extent(engine::World world);
/// A view in which all of this is seen, large; of a point, or of nothing, the default.
View fitted_view(const Extent& extent);
/// Where a point is in a view, from -1 (left, lower edge) to 1 in a window of rviz's shipped
/// configuration; z is its distance along the line of sight [m].
Eigen::Vector3d in_view(const View& view, const Eigen::Vector3d& point);

}  // namespace constraint_sim
