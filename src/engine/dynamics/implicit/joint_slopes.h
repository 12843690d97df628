#pragma once

#include <Eigen/Core>
#include <array>

#include "engine/constraints/joint_vectors.h"
#include "engine/constraints/rows.h"
#include "engine/dynamics/implicit/implicit_motion.h"
#include "engine/dynamics/implicit/link_in_step.h"

namespace constraint_sim::engine {

/// Derivative of a vector with respect to the displacement (Δx, w) of one end.
using Slope = Eigen::Matrix<double, 3, 6>;
/// Derivative of a number with respect to the displacement (Δx, w) of one end.
using Gradient = Eigen::Matrix<double, 1, 6>;

/// Derivatives of the vectors of a joint with respect to the displacement of one end.
struct VectorSlopes {
  Slope arm = Slope::Zero(), d = Slope::Zero();
  std::array<Slope, 3> axes{Slope::Zero(), Slope::Zero(), Slope::Zero()};

  Slope of(VectorRef u, std::size_t end) const {
    if (u.kind == VectorKind::kSeparation) return d;
    if (u.kind == (end == 0 ? VectorKind::kAxisA : VectorKind::kAxisB)) return axes[u.axis];
    return Slope::Zero();
  }
};

/// Derivatives of a row's J: of the force on B, and of the torques on A and B.
struct JacobianSlopes {
  Slope force = Slope::Zero(), torque_A = Slope::Zero(), torque_B = Slope::Zero();

  /// Adds the derivatives of Uᵀf, where f is the other vector of the row.
  void add(VectorRef u, VectorRef other, const JointVectors& v, const VectorSlopes& slopes,
           std::size_t end);
  void add(double lambda, const JacobianSlopes& of_row) {
    force += lambda * of_row.force;
    torque_A += lambda * of_row.torque_A;
    torque_B += lambda * of_row.torque_B;
  }
  /// Adds the derivative of a scalar factor of J, given the gradient of the factor.
  void add(const Jacobian& J, const Gradient& gradient) {
    force += J.j3 * gradient;
    torque_A += J.j2 * gradient;
    torque_B += J.j4 * gradient;
  }
  /// Adds `factor` times the difference of two Jacobians to the derivatives by component i.
  void add_difference(int i, double factor, const Jacobian& forth, const Jacobian& back) {
    force.col(i) += factor * (forth.j3 - back.j3);
    torque_A.col(i) += factor * (forth.j2 - back.j2);
    torque_B.col(i) += factor * (forth.j4 - back.j4);
  }
};

/// Vectors of a joint at the start and at the end of the step and where forces are taken, and the
/// slopes of its vectors at the end. Ends that do not move have no slopes.
struct JointInStep {
  double share = 0.5;  ///< share of the step at which forces are taken
  std::array<int, 2> dofs{};
  JointVectors at_start, at_end, at_force;
  std::array<VectorSlopes, 2> slopes;

  JointInStep(const ImplicitLink& link, const LinkInStep& state, const ImplicitMotion& motion,
              const List<double>& unknowns);
  /// Vectors at the end of the step after a change of component i of the displacement of end f.
  JointVectors displaced(std::size_t f, int i, double step) const;
};

}  // namespace constraint_sim::engine
