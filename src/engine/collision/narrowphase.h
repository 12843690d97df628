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

/// Contacts of two convex shapes, by a function for each pair of kinds in one of the two orders.
struct Collide {
  const BodyState& a;
  const BodyState& b;
  double margin = 0.0;  ///< [m]

  /// Returns up to one point. Coincident centres separate along z.
  Manifold operator()(const Sphere& sphere_a, const Sphere& sphere_b) const;
  Manifold operator()(const Sphere& sphere_a, const Plane&) const;

  /// Returns the vertices below the plane, up to eight.
  Manifold operator()(const Box& box_a, const Plane&) const;
  /// Returns up to one point. A centre inside the box leaves through the nearest face: on a tie the
  /// first along x, y, z, and from the exact middle through the positive side of that axis.
  Manifold operator()(const Box& box_a, const Sphere& sphere_b) const;
  /// Returns the overlap of two faces with up to eight points, or the crossing of two edges. The
  /// normal is the axis of least depth, or a face normal within 2.56° of it; moving A along it by
  /// the greatest depth separates the boxes. Features number edges of both boxes, whichever face is
  /// clipped. Separated boxes have a single point where other features are nearer, by a hundredth
  /// of the margin. A margin above a tenth of the smallest half edge may miss features beside the
  /// face.
  Manifold operator()(const Box& box_a, const Box& box_b) const;

  /// Returns up to five points: the lowest of each rim, and of the lower rim two at its sides and
  /// the opposite one. A cap level to 1e-4 has its points along the body's x and y axes.
  Manifold operator()(const Cylinder& cylinder_a, const Plane&) const;
  /// Returns up to one point. A centre inside the cylinder leaves through the nearest of side and
  /// caps, on a tie through the side.
  Manifold operator()(const Cylinder& cylinder_a, const Sphere& sphere_b) const;
  /// Return the contact of a face, edge, vertex, cap, side or rim with a cap, side or rim: up to
  /// eight points of a face and a cap, two of a line and an area or of parallel lines, else one.
  /// The normal is the axis of least depth, or a normal of a face or cap within 2.56° of it; moving
  /// A along it by the depth of separation() separates the shapes.
  Manifold operator()(const Box& box_a, const Cylinder& cylinder_b) const;
  Manifold operator()(const Cylinder& cylinder_a, const Cylinder& cylinder_b) const;
  Manifold operator()(const Hull& hull_a, const Cylinder& cylinder_b) const;

  /// Returns the vertices below the plane; of more than eight the deepest one and the outermost of
  /// the others.
  Manifold operator()(const Hull& hull_a, const Plane&) const;
  /// Returns up to one point. A centre inside the hull leaves through the nearest face, the first
  /// on ties.
  Manifold operator()(const Hull& hull_a, const Sphere& sphere_b) const;
  /// Return the overlap of two faces with up to eight points, the crossing of two edges, or the
  /// nearest points. The normal is the axis of least depth, the direction of the nearest points, or
  /// a face normal within 2.56° of it. Features number edges of both shapes, whichever face is
  /// clipped.
  Manifold operator()(const Hull& hull_a, const Hull& hull_b) const;
  Manifold operator()(const Box& box_a, const Hull& hull_b) const;

  /// Returns the ends of the capsule below the plane.
  Manifold operator()(const Capsule& capsule_a, const Plane&) const;
  /// Returns up to one point. A centre on the middle line of the capsule leaves across it.
  Manifold operator()(const Capsule& capsule_a, const Sphere& sphere_b) const;
  /// Return two points where the middle line of the capsule lies along a face or cap to 2.56°, or
  /// along an edge, side or capsule to 0.06°: the ends of their common part. Else the nearest
  /// point, or the deepest along the axis of least depth of the line, if the line crosses the
  /// shape.
  Manifold operator()(const Capsule& capsule_a, const Capsule& capsule_b) const;
  Manifold operator()(const Capsule& capsule_a, const Box& box_b) const;
  Manifold operator()(const Capsule& capsule_a, const Cylinder& cylinder_b) const;
  Manifold operator()(const Capsule& capsule_a, const Hull& hull_b) const;
};

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

/// Separations of the pairs of kinds whose contacts do not have the smallest gap: along the
/// direction of the nearest points, or the axis of least depth.
struct Separate {
  const BodyState& a;
  const BodyState& b;

  Separation operator()(const Box& box_a, const Box& box_b) const;
  Separation operator()(const Box& box_a, const Cylinder& cylinder_b) const;
  Separation operator()(const Cylinder& cylinder_a, const Cylinder& cylinder_b) const;
  Separation operator()(const Cylinder& cylinder_a, const Plane&) const;
  Separation operator()(const Hull& hull_a, const Hull& hull_b) const;
  Separation operator()(const Box& box_a, const Hull& hull_b) const;
  Separation operator()(const Hull& hull_a, const Cylinder& cylinder_b) const;
  Separation operator()(const Hull& hull_a, const Plane&) const;
  Separation operator()(const Capsule& capsule_a, const Capsule& capsule_b) const;
  Separation operator()(const Capsule& capsule_a, const Box& box_b) const;
  Separation operator()(const Capsule& capsule_a, const Cylinder& cylinder_b) const;
  Separation operator()(const Capsule& capsule_a, const Hull& hull_b) const;
};

/// Returns the separation of two boxes of these sizes [m].
Separation separation_of_boxes(const Eigen::Vector3d& size_a, const BodyState& a,
                               const Eigen::Vector3d& size_b, const BodyState& b);

/// Returns the separation of two convex shapes, except points and two planes; the gap is 0 where
/// they touch.
Separation separation(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                      const BodyState& b);

}  // namespace constraint_sim::engine
