#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "engine/constraints/moving_frame.h"

namespace constraint_sim::engine {

// Vectors whose products are the rows of a joint (Haug, Computer Aided Kinematics and Dynamics
// (1989), section 9.4), in world axes. x, y, z are the columns of the joint's frame on a body.

enum class VectorKind : std::uint8_t {
  kSeparation,  ///< d, from anchor A to anchor B [m]
  kAxisA,       ///< a, an axis of the frame on A
  kAxisB,       ///< b, an axis of the frame on B
  kWorldAxis,   ///< w, an axis of the world
  kCustom,      ///< no vector: the row is a function of another package
};

struct VectorRef {
  VectorKind kind = VectorKind::kSeparation;
  std::uint8_t axis = 0;  ///< 0, 1, 2: x, y, z; not used for d
};

constexpr bool operator==(VectorRef a, VectorRef b) { return a.kind == b.kind && a.axis == b.axis; }

/// Vectors of a joint at a pose, or their means over a step.
struct JointVectors {
  Eigen::Vector3d r_A = Eigen::Vector3d::Zero(), r_B = Eigen::Vector3d::Zero();  ///< arms [m]
  Eigen::Vector3d d = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes_A = Eigen::Matrix3d::Identity(), axes_B = Eigen::Matrix3d::Identity();
  const CustomCode* custom = nullptr;  ///< functions of a custom joint, which owns them

  JointVectors() = default;
  /// Takes arms and axes on A and B.
  JointVectors(const std::array<Eigen::Vector3d, 2>& arms, const Eigen::Vector3d& separation,
               const std::array<Eigen::Matrix3d, 2>& axes, const CustomCode* code)
      : r_A(arms[0]), r_B(arms[1]), d(separation), axes_A(axes[0]), axes_B(axes[1]), custom(code) {}
  JointVectors(const Joint& joint, const BodyState& a, const BodyState& b);
  /// Uses the moving frame on B in place of the joint's own.
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

/// Returns vectors at a share of the way from `start` to `end`; at ½ the means.
JointVectors between(const JointVectors& start, const JointVectors& end, double share);

/// Rates of the vectors: ḋ = v_B + ω_B × r_B − v_A − ω_A × r_A, and the acceleration of d without
/// accelerations of the bodies, ω_B × (ω_B × r_B) − ω_A × (ω_A × r_A).
struct JointMotion {
  Eigen::Vector3d d_dot = Eigen::Vector3d::Zero(), d_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d w_A = Eigen::Vector3d::Zero(), w_B = Eigen::Vector3d::Zero();
  /// Angular velocity Ω of the frame on B relative to B, and its part of the frame's angular
  /// acceleration, Ω̇ + ω_B × Ω, with Ω̇ in B's axes.
  Eigen::Vector3d spin = Eigen::Vector3d::Zero(), spin_bias = Eigen::Vector3d::Zero();

  JointMotion() = default;
  JointMotion(const JointVectors& vectors, const BodyState& a, const BodyState& b);

  /// Adds the motion of the frame on B relative to B; `R_B` rotates B's frame into the world's.
  void add(const MovingFrame& frame_b, const Eigen::Matrix3d& R_B);

  /// Returns the rate u̇ of a vector.
  Eigen::Vector3d rate(VectorRef u, const JointVectors& vectors) const;
  /// Returns β_u = ü without the accelerations of the bodies.
  Eigen::Vector3d bias(VectorRef u, const JointVectors& vectors) const;
};

}  // namespace constraint_sim::engine
