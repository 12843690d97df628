#pragma once

#include <Eigen/Core>

#include "constraint_sim/body.h"
#include "constraint_sim/contact.h"

namespace constraint_sim {

// Stage 2 of a step: where two shapes touch. One function per pair of shapes; all answer a Manifold
// whose normal points from the second shape to the first and whose positions lie on the second
// shape's surface. Exactly touching is no contact.

Manifold collide_sphere_sphere(const Eigen::Vector3d& p_a, double radius_a,
                               const Eigen::Vector3d& p_b, double radius_b);

/// The solid half-space is N·x ≤ d, N a unit vector.
Manifold collide_sphere_plane(const Eigen::Vector3d& p_a, double radius_a, const Eigen::Vector3d& N,
                              double d);

Manifold collide_box_plane(const Eigen::Vector3d& size_a, const BodyState& a,
                           const Eigen::Vector3d& N, double d);

Manifold collide_box_sphere(const Eigen::Vector3d& size_a, const BodyState& a,
                            const Eigen::Vector3d& p_b, double radius_b);

Manifold collide_box_box(const Eigen::Vector3d& size_a, const BodyState& a,
                         const Eigen::Vector3d& size_b, const BodyState& b);

/// Any two shapes, in either order; points, and two planes, never touch.
Manifold collide(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                 const BodyState& b);

}  // namespace constraint_sim
