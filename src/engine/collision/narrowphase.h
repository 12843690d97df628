#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <variant>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/contact.h"
#include "engine/collision/placed_shape.h"

namespace constraint_sim::engine {

// Stage 2 of a step: contact points of two convex shapes, by a function per pair of shapes. The
// normal of a Manifold points from the second shape to the first; positions lie on the second
// shape's surface. Exact touching is no contact. A margin [m] adds points with a smaller gap, with
// negative depth and the features that they keep when they touch. No length is neglected: scenes of
// micrometres and of kilometres behave alike. Orientations are unit.

/// Returns up to one point. Coincident centres separate along z.
Manifold collide_sphere_sphere(const Eigen::Vector3d& p_a, double radius_a,
                               const Eigen::Vector3d& p_b, double radius_b, double margin = 0.0);

/// Returns up to one point. The solid half-space is N·x ≤ d, N a unit vector.
Manifold collide_sphere_plane(const Eigen::Vector3d& p_a, double radius_a, const Eigen::Vector3d& N,
                              double d, double margin = 0.0);

/// Returns the vertices below the plane, up to eight. The solid half-space is N·x ≤ d, N a unit
/// vector.
Manifold collide_box_plane(const Eigen::Vector3d& size_a, const BodyState& a,
                           const Eigen::Vector3d& N, double d, double margin = 0.0);

/// Returns up to one point. A centre inside the box leaves through the nearest face: on a tie the
/// first along x, y, z, and from the exact middle through the positive side of that axis.
Manifold collide_box_sphere(const Eigen::Vector3d& size_a, const BodyState& a,
                            const Eigen::Vector3d& p_b, double radius_b, double margin = 0.0);

/// Returns the overlap of two faces with up to eight points, or the crossing of two edges. The
/// normal is the axis of least depth, or a face normal within 2.56° of it; moving A along it by the
/// greatest depth separates the boxes. Features number edges of both boxes, whichever face is
/// clipped. Separated boxes have a single point where other features are nearer, by a hundredth of
/// the margin. A margin above a tenth of the smallest half edge may miss features beside the face.
Manifold collide_box_box(const Eigen::Vector3d& size_a, const BodyState& a,
                         const Eigen::Vector3d& size_b, const BodyState& b, double margin = 0.0);

/// Returns up to five points: the lowest of each rim, and of the lower rim two at its sides and the
/// opposite one. A cap level to 1e-4 has its points along the body's x and y axes. The solid
/// half-space is N·x ≤ d, N a unit vector.
Manifold collide_cylinder_plane(const Cylinder& cylinder_a, const BodyState& a,
                                const Eigen::Vector3d& N, double d, double margin = 0.0);

/// Returns up to one point. A centre inside the cylinder leaves through the nearest of side and
/// caps, on a tie through the side.
Manifold collide_cylinder_sphere(const Cylinder& cylinder_a, const BodyState& a,
                                 const Eigen::Vector3d& p_b, double radius_b, double margin = 0.0);

/// Returns the contact of a face, edge or vertex of the box with a cap, side or rim: up to eight
/// points of a face and a cap, two of a line and an area or of parallel lines, else one. The normal
/// is the axis of least depth, or a normal of a face or cap within 2.56° of it; moving A along it
/// by the depth of separation() separates the shapes.
Manifold collide_box_cylinder(const Eigen::Vector3d& size_a, const BodyState& a,
                              const Cylinder& cylinder_b, const BodyState& b, double margin = 0.0);

/// Returns the contact of two cylinders like collide_box_cylinder().
Manifold collide_cylinder_cylinder(const Cylinder& cylinder_a, const BodyState& a,
                                   const Cylinder& cylinder_b, const BodyState& b,
                                   double margin = 0.0);

/// Returns the vertices below the plane; of more than eight the deepest one and the outermost of
/// the others. The solid half-space is N·x ≤ d, N a unit vector.
Manifold collide_hull_plane(const Hull& hull_a, const BodyState& a, const Eigen::Vector3d& N,
                            double d, double margin = 0.0);

/// Returns up to one point. A centre inside the hull leaves through the nearest face, the first on
/// ties.
Manifold collide_hull_sphere(const Hull& hull_a, const BodyState& a, const Eigen::Vector3d& p_b,
                             double radius_b, double margin = 0.0);

/// Returns the overlap of two faces with up to eight points, the crossing of two edges, or the
/// nearest points. The normal is the axis of least depth, the direction of the nearest points, or a
/// face normal within 2.56° of it. Features number edges of both shapes, whichever face is clipped.
Manifold collide_hull_hull(const Hull& hull_a, const BodyState& a, const Hull& hull_b,
                           const BodyState& b, double margin = 0.0);

/// Returns the contact of a box and a hull like collide_hull_hull().
Manifold collide_box_hull(const Eigen::Vector3d& size_a, const BodyState& a, const Hull& hull_b,
                          const BodyState& b, double margin = 0.0);

/// Returns the contact of a hull and a cylinder like collide_box_cylinder().
Manifold collide_hull_cylinder(const Hull& hull_a, const BodyState& a, const Cylinder& cylinder_b,
                               const BodyState& b, double margin = 0.0);

/// Returns the ends of the capsule below the plane. The solid half-space is N·x ≤ d, N a unit
/// vector.
Manifold collide_capsule_plane(const Capsule& capsule_a, const BodyState& a,
                               const Eigen::Vector3d& N, double d, double margin = 0.0);

/// Returns up to one point. A centre on the middle line of the capsule leaves across it.
Manifold collide_capsule_sphere(const Capsule& capsule_a, const BodyState& a,
                                const Eigen::Vector3d& p_b, double radius_b, double margin = 0.0);

/// Return two points where the middle line of the capsule lies along a face or cap to 2.56°, or
/// along an edge, side or capsule to 0.06°: the ends of their common part. Else the nearest point,
/// or the deepest along the axis of least depth of the line, if the line crosses the shape.
Manifold collide_capsule_capsule(const Capsule& capsule_a, const BodyState& a,
                                 const Capsule& capsule_b, const BodyState& b, double margin = 0.0);
Manifold collide_capsule_box(const Capsule& capsule_a, const BodyState& a,
                             const Eigen::Vector3d& size_b, const BodyState& b,
                             double margin = 0.0);
Manifold collide_capsule_cylinder(const Capsule& capsule_a, const BodyState& a,
                                  const Cylinder& cylinder_b, const BodyState& b,
                                  double margin = 0.0);
Manifold collide_capsule_hull(const Capsule& capsule_a, const BodyState& a, const Hull& hull_b,
                              const BodyState& b, double margin = 0.0);

/// Returns the contact of two convex shapes in any order; points, and two planes, never touch. The
/// normal of a plane is the z axis of its body.
Manifold collide(const Shape& shape_a, const BodyState& a, const Shape& shape_b, const BodyState& b,
                 double margin = 0.0);

inline Manifold collide(const PlacedShape& a, const PlacedShape& b, double margin = 0.0) {
  return collide(a.shape(), a.state(), b.shape(), b.state(), margin);
}

/// Separating plane of two shapes, or the least translation that separates overlapping ones.
struct Separation {
  Eigen::Vector3d normal;  ///< unit, from B to A
  double gap;  ///< gap along the normal, ≤ distance of the shapes [m]; < 0: overlapping
};

/// Returns the separation of two boxes.
Separation separation_of_boxes(const Eigen::Vector3d& size_a, const BodyState& a,
                               const Eigen::Vector3d& size_b, const BodyState& b);

/// Return the separation of a box and a cylinder, of two cylinders, and of a cylinder and a plane.
Separation separation_of_box_and_cylinder(const Eigen::Vector3d& size_a, const BodyState& a,
                                          const Cylinder& cylinder_b, const BodyState& b);
Separation separation_of_cylinders(const Cylinder& cylinder_a, const BodyState& a,
                                   const Cylinder& cylinder_b, const BodyState& b);
Separation separation_of_cylinder_and_plane(const Cylinder& cylinder_a, const BodyState& a,
                                            const Eigen::Vector3d& N, double d);

/// Return the separation of a hull and another shape, along the direction of the nearest points or
/// the axis of least depth.
Separation separation_of_hulls(const Hull& hull_a, const BodyState& a, const Hull& hull_b,
                               const BodyState& b);
Separation separation_of_box_and_hull(const Eigen::Vector3d& size_a, const BodyState& a,
                                      const Hull& hull_b, const BodyState& b);
Separation separation_of_hull_and_cylinder(const Hull& hull_a, const BodyState& a,
                                           const Cylinder& cylinder_b, const BodyState& b);
Separation separation_of_hull_and_plane(const Hull& hull_a, const BodyState& a,
                                        const Eigen::Vector3d& N, double d);

/// Return the separation of a capsule and another shape, along the direction of the nearest points
/// or the axis of least depth.
Separation separation_of_capsules(const Capsule& capsule_a, const BodyState& a,
                                  const Capsule& capsule_b, const BodyState& b);
Separation separation_of_capsule_and_box(const Capsule& capsule_a, const BodyState& a,
                                         const Eigen::Vector3d& size_b, const BodyState& b);
Separation separation_of_capsule_and_cylinder(const Capsule& capsule_a, const BodyState& a,
                                              const Cylinder& cylinder_b, const BodyState& b);
Separation separation_of_capsule_and_hull(const Capsule& capsule_a, const BodyState& a,
                                          const Hull& hull_b, const BodyState& b);

/// Returns the separation of two convex shapes, except points and two planes; the gap is 0 where
/// they touch.
Separation separation(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                      const BodyState& b);

}  // namespace constraint_sim::engine
