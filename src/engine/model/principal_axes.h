#pragma once

#include <Eigen/Core>

namespace constraint_sim::engine {

/// Share of the size to which solids are centred; moving a solid to its centre leaves some 1e-15.
inline constexpr double kCentred = 1e-12;

/// Principal axes of a tensor of inertia, each nearest to the axis of the frame with its number.
struct PrincipalAxes {
  bool is_along;            ///< whether the axes of the frame are principal axes
  Eigen::Matrix3d axes;     ///< axes as columns, a rotation; the identity where `is_along`
  Eigen::Vector3d moments;  ///< about each axis
};

/// Returns the principal axes of a symmetric tensor. Entries off the diagonal up to `rounding`
/// count as 0.
PrincipalAxes principal_axes(const Eigen::Matrix3d& tensor, double rounding);

}  // namespace constraint_sim::engine
