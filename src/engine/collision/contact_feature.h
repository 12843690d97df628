#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/shape.h"
#include "engine/collision/contact_tolerances.h"
#include "engine/math/list.h"
#include "engine/model/jacobian.h"

namespace constraint_sim::engine {

// Feature by which two shapes touch, with a gap g that is smooth in time while the feature stays. A
// rounded point c of A (centre of a sphere or of an end of a capsule, or corner of a box with
// radius 0) touches B:
//   plane  g = n·(c − o) − r_A            n, o fixed to B
//   line   g = ‖d‖ − r_A                  d from the nearest point of the line to c
//   point  g = ‖c − o‖ − r_A − r_B
// Two boxes also have a corner of B on a plane of A (kPlaneOfA), and edges u of A and v of B:
//   edges  g = n·(c_A − c_B)              n = ± u × v / ‖u × v‖, c nearest on their lines

struct ContactFeature {
  enum class Kind : char { kPlane, kLine, kPoint, kPlaneOfA, kEdges, kNothing };
  Kind kind = Kind::kPlane;
  /// Point of A, or a point of its plane or edge, in A [m].
  Eigen::Vector3d on_a = Eigen::Vector3d::Zero();
  /// Point of B's plane, line or edge, or corner of B, in B [m].
  Eigen::Vector3d on_b = Eigen::Vector3d::Zero();
  /// Normal of B's plane, or direction of its line or edge, in B.
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  /// Normal of A's plane, or direction of its edge, in A.
  Eigen::Vector3d axis_a = Eigen::Vector3d::UnitZ();
  double sign = 1.0;                      ///< sign of n for edges
  double radius_a = 0.0, radius_b = 0.0;  ///< radii of rounded points [m]
  std::uint32_t id = 0;                   ///< number of the feature within its pair
};

/// Motion of a contact feature. With n from B to A, the contact point p, and the velocity w = v_A +
/// ω_A × r_A − v_B − ω_B × r_B of A relative to B at p:
///   ġ = n·w,  g̈ = n·ẇ + ṅ·w,  ẇ = J V̇ + ω_A × (ṗ − v_A) − ω_B × (ṗ − v_B)
struct ContactMotion {
  double gap = 0.0;                              ///< gap [m]; < 0: overlapping
  Eigen::Vector3d n = Eigen::Vector3d::UnitZ();  ///< unit normal from B to A
  Eigen::Vector3d n_dot = Eigen::Vector3d::Zero();
  Eigen::Vector3d p = Eigen::Vector3d::Zero();  ///< contact point on A's surface, world [m]
  Eigen::Vector3d r_a = Eigen::Vector3d::Zero(), r_b = Eigen::Vector3d::Zero();  ///< arms to p [m]
  Eigen::Vector3d w = Eigen::Vector3d::Zero();       ///< velocity of A relative to B at p [m/s]
  Eigen::Vector3d w_bias = Eigen::Vector3d::Zero();  ///< ẇ without accelerations of the bodies

  double gap_rate() const { return n.dot(w); }
  /// Returns the Jacobian of the velocity of A relative to B at p along d.
  Jacobian along(const Eigen::Vector3d& d) const { return {d, r_a.cross(d), -d, -r_b.cross(d)}; }
  /// Returns w without its part along n.
  Eigen::Vector3d slip() const { return w - n * n.dot(w); }
};

/// Returns the motion of a feature; the gap of kNothing is infinite.
ContactMotion motion_of(const ContactFeature& feature, const BodyState& a, const BodyState& b);
/// Returns the motion of a feature of kind kEdges.
ContactMotion motion_of_edges(const ContactFeature& feature, const BodyState& a,
                              const BodyState& b);
/// Sets w and its bias from p, the arms and the velocity of p.
void set_velocities(const Eigen::Vector3d& p_dot, const BodyState& a, const BodyState& b,
                    ContactMotion* motion);

/// Whether features of two shapes, in this order, are implemented: sphere with sphere, box and
/// plane; box with box and plane; capsule with plane.
bool has_features(const Shape& a, const Shape& b);

/// Adds the features by which shapes A and B may touch at their present poses. The order of the
/// shapes has features: a sphere is A of a box or plane, and a box or capsule is A of a plane.
/// Throws std::logic_error for an order for which has_features() is false. The number of features
/// of a pair is the same at every pose; two boxes fill it up with kNothing. The centre of a sphere
/// inside a box touches the nearest face.
void add_features(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                  const BodyState& b, const ContactTolerances& within,
                  List<ContactFeature>* features);

/// Whether a shape has borders between its faces, edges and corners: with such a shape as B, the
/// features of a pair change with the poses.
struct HasBorders {
  bool operator()(const Point&) const { return false; }
  bool operator()(const Sphere&) const { return false; }
  bool operator()(const Box&) const { return true; }
  bool operator()(const Plane&) const { return false; }
  bool operator()(const Cylinder&) const { return false; }
  bool operator()(const Hull&) const { return false; }
  bool operator()(const Capsule&) const { return false; }
  bool operator()(const Compound&) const { return false; }
};

/// Distance and rate of a contact from the border beyond which another face, edge or corner of a
/// box is the nearest; the least over all borders. Infinite for shapes without a box B.
struct FeatureMargin {
  double value, rate;
};
FeatureMargin margin_of(const ContactFeature& feature, const Shape& shape_a, const BodyState& a,
                        const Shape& shape_b, const BodyState& b);

}  // namespace constraint_sim::engine
