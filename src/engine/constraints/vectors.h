#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "engine/constraints/moving_frame.h"

namespace constraint_sim::engine {

// The four vectors that rows are products of (Haug, Computer Aided Kinematics and Dynamics (1989),
// section 9.4). World axes; x, y, z are the columns of the joint's frame on a body.

enum class VectorKind : std::uint8_t {
  kSeparation,  ///< d, from anchor A to anchor B [m]
  kAxisA,       ///< a, an axis of the frame on A
  kAxisB,       ///< b, an axis of the frame on B
  kWorldAxis,   ///< w, an axis of the world
  kCustom,      ///< none: the row is a function of another package
};

struct VectorRef {
  VectorKind kind = VectorKind::kSeparation;
  std::uint8_t axis = 0;  ///< 0, 1, 2: x, y, z; of d not used
};

constexpr bool operator==(VectorRef a, VectorRef b) { return a.kind == b.kind && a.axis == b.axis; }

/// The vectors of a joint at a pose, or their means over a step.
struct JointVectors {
  Eigen::Vector3d r_A = Eigen::Vector3d::Zero(), r_B = Eigen::Vector3d::Zero();  ///< arms [m]
  Eigen::Vector3d d = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes_A = Eigen::Matrix3d::Identity(), axes_B = Eigen::Matrix3d::Identity();
  const CustomCode* custom = nullptr;  ///< of kinds that are custom; the joint keeps it

  JointVectors() = default;
  JointVectors(const Joint& joint, const BodyState& a, const BodyState& b);
  /// With the frame on B where it is now.
  JointVectors(const Joint& joint, const BodyState& a, const BodyState& b,
               const MovingFrame& frame_b);

  Eigen::Vector3d operator[](VectorRef u) const {
    switch (u.kind) {
      case VectorKind::kSeparation:
        return d;
      case VectorKind::kAxisA:
        return axes_A.col(u.axis);
      case VectorKind::kAxisB:
        return axes_B.col(u.axis);
      case VectorKind::kWorldAxis:
        return Eigen::Vector3d::Unit(u.axis);
      case VectorKind::kCustom:
        break;
    }
    return d;
  }
};

/// The vectors a share of the way from those of one pose to those of another; at ½ their means.
JointVectors between(const JointVectors& start, const JointVectors& end, double share);

/// How they move: ḋ = v_B + ω_B × r_B − v_A − ω_A × r_A, and of d what it accelerates by while no
/// body does, ω_B × (ω_B × r_B) − ω_A × (ω_A × r_A).
struct JointMotion {
  Eigen::Vector3d d_dot = Eigen::Vector3d::Zero(), d_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d w_A = Eigen::Vector3d::Zero(), w_B = Eigen::Vector3d::Zero();
  /// Of the frame on B against B, and what that adds to its angular acceleration: Ω̇ + ω_B × Ω, Ω̇
  /// as B sees it.
  Eigen::Vector3d spin = Eigen::Vector3d::Zero(), spin_bias = Eigen::Vector3d::Zero();

  JointMotion() = default;
  JointMotion(const JointVectors& vectors, const BodyState& a, const BodyState& b);

  /// Adds what the frame on B moves by itself; `R_B` turns B's frame into the world's.
  void add(const MovingFrame& frame_b, const Eigen::Matrix3d& R_B);

  /// u̇ of one vector.
  Eigen::Vector3d rate(VectorRef u, const JointVectors& vectors) const;
  /// β_u = ü less what the bodies' accelerations make of it.
  Eigen::Vector3d bias(VectorRef u, const JointVectors& vectors) const;
};

}  // namespace constraint_sim::engine
