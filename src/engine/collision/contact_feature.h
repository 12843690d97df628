#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/row.h"
#include "constraint_sim/engine/shape.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

// What of two shapes meets, as methods want it that follow a contact in time: a gap g that is
// smooth while these features meet. A rounded point of A (the centre of a sphere, or a corner of a
// box, of radius 0) meets a plane, a line or a rounded point of B:
//   plane  g = n·(c − o) − r_A            n, o fixed to B
//   line   g = ‖d‖ − r_A                  d from the nearest point of the line to c
//   point  g = ‖c − o‖ − r_A − r_B
// Of two boxes (box_features.h) also a corner of B meets a plane of A, and edges u of A and v of B
//   edges  g = n·(c_A − c_B)               n = ± u × v / ‖u × v‖
// each other, where their lines are nearest.
// With n from B to A and p the point where they touch, w = v_A + ω_A × r_A − v_B − ω_B × r_B the
// velocity of A's material against B's there:
//   ġ = n·w,  g̈ = n·ẇ + ṅ·w,  ẇ = J V̇ + ω_A × (ṗ − v_A) − ω_B × (ṗ − v_B)

struct ContactFeature {
  enum class Kind : char { kPlane, kLine, kPoint, kPlaneOfA, kEdges, kNothing };
  Kind kind = Kind::kPlane;
  Eigen::Vector3d on_a =
      Eigen::Vector3d::Zero();  ///< the point of A, or of its plane or edge, in A [m]
  Eigen::Vector3d on_b = Eigen::Vector3d::Zero();  ///< of the plane, line or corner of B, in B [m]
  Eigen::Vector3d axis =
      Eigen::Vector3d::UnitZ();  ///< normal of the plane, or along the line, in B
  Eigen::Vector3d axis_a = Eigen::Vector3d::UnitZ();  ///< the same of A, in A
  double sign = 1.0;                                  ///< of n, of edges
  double radius_a = 0.0, radius_b = 0.0;              ///< [m]
  std::uint32_t id = 0;                               ///< among those of its pair
};

/// A contact as two bodies move.
struct ContactMotion {
  double gap = 0.0;                              ///< [m]; < 0: overlapping
  Eigen::Vector3d n = Eigen::Vector3d::UnitZ();  ///< unit, from B to A
  Eigen::Vector3d n_dot = Eigen::Vector3d::Zero();
  Eigen::Vector3d p = Eigen::Vector3d::Zero();  ///< on A's surface [m]
  Eigen::Vector3d r_a = Eigen::Vector3d::Zero(), r_b = Eigen::Vector3d::Zero();  ///< arms to p
  Eigen::Vector3d w = Eigen::Vector3d::Zero();       ///< of A against B in p [m/s]
  Eigen::Vector3d w_bias = Eigen::Vector3d::Zero();  ///< ẇ without accelerations of the bodies

  double gap_rate() const { return n.dot(w); }
  /// Of the velocity of A against B in p along d, with A first.
  Jacobian along(const Eigen::Vector3d& d) const { return {d, r_a.cross(d), -d, -r_b.cross(d)}; }
  /// w without its part along n.
  Eigen::Vector3d slip() const { return w - n * n.dot(w); }
};

/// Of nothing: an infinite gap.
ContactMotion motion_of(const ContactFeature& feature, const BodyState& a, const BodyState& b);
/// The same of edges.
ContactMotion motion_of_edges(const ContactFeature& feature, const BodyState& a,
                              const BodyState& b);
/// w and its bias, with p and the arms to it known and p moving so.
void set_velocities(const Eigen::Vector3d& p_dot, const BodyState& a, const BodyState& b,
                    ContactMotion* motion);

/// Whether the features of two shapes, A first, are known: spheres with spheres, boxes and planes,
/// and boxes with boxes and planes.
bool has_features(const Shape& a, const Shape& b);

/// What of A can meet what of B as they lie; the same number whatever lies where. The centre of a
/// sphere in a box meets the nearest face. A must come first as has_features() has it.
void add_features(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                  const BodyState& b, List<ContactFeature>* features);

/// How far, and how fast, a point of A is from where it meets another face, edge or corner of a box
/// B than `feature` says, or of two boxes from where other ones meet: the least of several.
/// Infinite of other shapes.
struct FeatureMargin {
  double value, rate;
};
FeatureMargin margin_of(const ContactFeature& feature, const Shape& shape_a, const BodyState& a,
                        const Shape& shape_b, const BodyState& b);

}  // namespace constraint_sim::engine
