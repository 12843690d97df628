#pragma once

#include <Eigen/Core>
#include <optional>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/contact.h"

namespace constraint_sim::engine {

// Stage 2 of a step: where two shapes touch. One function per pair of shapes; all answer a Manifold
// whose normal points from the second shape to the first and whose positions lie on the second
// shape's surface. Exactly touching is no contact. With a margin [m],
// points whose gap is less than that are there as well, with negative depths and the features that
// they keep when they touch. There is no length below which anything is
// neglected: scenes of micrometres and of kilometres behave alike. Orientations are unit.

/// Where a shape lies in its body, and how it moves there.
BodyState beside(const BodyState& body, const ShapePose& pose);

/// Where the shape of a body lies that is at `state`: there, or beside it. Refers to `state`.
class PlacedShape {
 public:
  PlacedShape(const Body& body, const BodyState& state) : shape_(body.shape), state_(&state) {
    if (body.shape_pose) state_ = &beside_.emplace(beside(state, *body.shape_pose));
  }
  PlacedShape(const PlacedShape&) = delete;
  PlacedShape& operator=(const PlacedShape&) = delete;

  const Shape& shape() const { return shape_; }
  const BodyState& state() const { return *state_; }

 private:
  const Shape& shape_;
  const BodyState* state_;
  std::optional<BodyState> beside_;
};

/// One point. Coincident centres part along z.
Manifold collide_sphere_sphere(const Eigen::Vector3d& p_a, double radius_a,
                               const Eigen::Vector3d& p_b, double radius_b, double margin = 0.0);

/// One point. The solid half-space is N·x ≤ d, N a unit vector.
Manifold collide_sphere_plane(const Eigen::Vector3d& p_a, double radius_a, const Eigen::Vector3d& N,
                              double d, double margin = 0.0);

/// The vertices below the plane, up to eight. The solid half-space is N·x ≤ d, N a unit vector.
Manifold collide_box_plane(const Eigen::Vector3d& size_a, const BodyState& a,
                           const Eigen::Vector3d& N, double d, double margin = 0.0);

/// One point. A centre inside the box leaves through the nearest face, on a tie the first of them
/// along x, y, z, and from the very middle through that axis' positive side.
Manifold collide_box_sphere(const Eigen::Vector3d& size_a, const BodyState& a,
                            const Eigen::Vector3d& p_b, double radius_b, double margin = 0.0);

/// The polygon in which two faces overlap, up to eight points, or one point where two edges cross.
/// Moving A along the normal by the greatest depth parts the boxes. The normal is the one of least
/// depth; a face's where it is within 2.5° of that. Features name edges of the two boxes, so they
/// do not depend on which face was clipped by which. Boxes apart that are nearer
/// elsewhere than at such points, by a hundredth of the margin, have one point there. A margin
/// above a tenth of the smallest half edge is too large for what lies beside the face to be seen in
/// time.
Manifold collide_box_box(const Eigen::Vector3d& size_a, const BodyState& a,
                         const Eigen::Vector3d& size_b, const BodyState& b, double margin = 0.0);

/// The rims' points lowest to the plane, and of the lower rim those a quarter on: up to five. Of a
/// cap level to 1e-4 those along the body's x and y axes. The solid half-space is N·x ≤ d, N a unit
/// vector.
Manifold collide_cylinder_plane(const Cylinder& cylinder_a, const BodyState& a,
                                const Eigen::Vector3d& N, double d, double margin = 0.0);

/// One point. A centre inside the cylinder leaves through the nearest of the side, which wins a
/// tie, and the caps.
Manifold collide_cylinder_sphere(const Cylinder& cylinder_a, const BodyState& a,
                                 const Eigen::Vector3d& p_b, double radius_b, double margin = 0.0);

/// Where a face, an edge or a vertex of the box meets a cap, a side or a rim: up to eight points of
/// a face and a cap, two of a line and an area or of parallel lines, else one. Moving A along the
/// normal by the depth that separation() has parts the two. The normal is the one of least depth;
/// that of a face or cap where it is within 2.56° of that.
Manifold collide_box_cylinder(const Eigen::Vector3d& size_a, const BodyState& a,
                              const Cylinder& cylinder_b, const BodyState& b, double margin = 0.0);

/// The same of two cylinders.
Manifold collide_cylinder_cylinder(const Cylinder& cylinder_a, const BodyState& a,
                                   const Cylinder& cylinder_b, const BodyState& b,
                                   double margin = 0.0);

/// Any two shapes at these states, in either order; points, and two planes, never touch. A plane's
/// body says where it is: N is its z axis.
Manifold collide(const Shape& shape_a, const BodyState& a, const Shape& shape_b, const BodyState& b,
                 double margin = 0.0);

inline Manifold collide(const PlacedShape& a, const PlacedShape& b, double margin = 0.0) {
  return collide(a.shape(), a.state(), b.shape(), b.state(), margin);
}

/// A plane between two shapes, or where they overlap the least that would part them.
struct Separation {
  Eigen::Vector3d normal;  ///< unit, from B to A
  double gap;  ///< between them along the normal, ≤ their distance [m]; < 0: overlapping
};

/// Of two boxes.
Separation separation_of_boxes(const Eigen::Vector3d& size_a, const BodyState& a,
                               const Eigen::Vector3d& size_b, const BodyState& b);

/// Of a box and a cylinder, of two cylinders, and of a cylinder and a plane.
Separation separation_of_box_and_cylinder(const Eigen::Vector3d& size_a, const BodyState& a,
                                          const Cylinder& cylinder_b, const BodyState& b);
Separation separation_of_cylinders(const Cylinder& cylinder_a, const BodyState& a,
                                   const Cylinder& cylinder_b, const BodyState& b);
Separation separation_of_cylinder_and_plane(const Cylinder& cylinder_a, const BodyState& a,
                                            const Eigen::Vector3d& N, double d);

/// Of any two shapes but points and two planes; 0 where they touch.
Separation separation(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                      const BodyState& b);

}  // namespace constraint_sim::engine
