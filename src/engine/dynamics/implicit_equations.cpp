// Equations of an ImplicitStep and their derivative. General joints are in implicit_joints.cpp.

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/dynamics/implicit_step.h"
#include "engine/math/cross_matrix.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

}  // namespace

void ImplicitStep::evaluate(const Unknowns& unknowns) {
  std::fill(lu_.values().begin(), lu_.values().end(), 0.0);
  worst_row_ = worst_momentary_row_ = 0.0;
  evaluate_bodies(unknowns);
  for (std::size_t l = 0; l < links_.size(); ++l) {
    if (links_[l].is_between_points)
      evaluate_rod(links_[l], &shapes_[l], unknowns);
    else if (links_[l].kind == Kind::kGeneral)
      evaluate_general(links_[l], &shapes_[l], unknowns);
    else
      evaluate_link(links_[l], &shapes_[l], unknowns);
  }
  for (CoupledRow& coupled : coupled_) evaluate_coupled(&coupled, unknowns);
  // Derivative of ½ŵ T, which needs the total torque.
  std::size_t slot = 0;
  for (std::size_t i = 0; i < rotating_; ++i) {
    slot += 3;
    const double scale =
        left_[to_index(first_unknown_[i]) + 3] * right_[to_index(first_unknown_[i]) + 3];
    const Matrix3d change = (-0.5 * s_ * scale) * cross_matrix(J_angular_[i].torque);
    for (int k = 0; k < 3; ++k)
      for (int m = 0; m < 3; ++m) lu_.values()[diagonal_[slot++]] += change(k, m);
  }
  for (std::size_t u = 0; u < residual_.size(); ++u) residual_[u] *= left_[u];
}

// Evaluates inertia and constant loads of the bodies.
void ImplicitStep::evaluate_bodies(const Unknowns& unknowns) {
  double* const values = lu_.values().data();
  std::size_t slot = 0;
  for (std::size_t i = 0; i < bodies_; ++i) {
    const auto first = to_index(first_unknown_[i]);
    const ConstVector dx(unknowns.data() + first);
    Vector(residual_.data() + first) = mass_[i] * (dx - p_[i]) - s_ * force_[i];
    for (int k = 0; k < 3; ++k) values[diagonal_[slot++]] += 1.0;
    if (i >= rotating_) continue;

    Turning& turn = J_angular_[i];
    const ConstVector w(unknowns.data() + first + 3);
    const Vector3d J_w = turn.J0 * (w - turn.a);
    turn.B = mean_rotation(w);
    turn.C = Matrix3d::Identity() - 0.5 * cross_matrix(w);
    turn.torque = torque_[i];
    Vector(residual_.data() + first + 3) =
        J_w + 0.5 * w.cross(J_w) - turn.C * (turn.b + s_ * torque_[i]);
    const Matrix3d derivative =
        (turn.J0 + 0.5 * (cross_matrix(w) * turn.J0 - cross_matrix(J_w + turn.b))) *
        (left_[first + 3] * right_[first + 3]);
    for (int k = 0; k < 3; ++k)
      for (int m = 0; m < 3; ++m) values[diagonal_[slot++]] += derivative(k, m);
  }
}

// Motion of a rod, ball joint or spring in the step.
struct ImplicitStep::LinkMotion {
  Vector3d d1;                  // d at the end of the step
  std::array<Vector3d, 2> arm;  // arms where forces are taken
  // Derivative of d at the end of the step, without the sign of the body's end.
  std::array<VectorSlopes::Slope, 2> E;
};

// Force on B with its derivatives by d and λ; values of the rows with their derivative by d1.
struct ImplicitStep::LinkPull {
  Matrix3d P = Matrix3d::Zero();
  // Columns per row; one column for rods and springs.
  Matrix3d pull = Matrix3d::Identity(), gradient = pull;
  Vector3d value;
};

ImplicitStep::LinkMotion ImplicitStep::move_link(const Link& link, Shape* shape,
                                                 const Unknowns& unknowns) const {
  LinkMotion motion;
  Vector3d change = Vector3d::Zero();  // change of d
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    if (end.dofs == 0) {
      change += end.sign * shift_[end.point];
      continue;
    }
    const auto first = to_index(end.unknown);
    change += end.sign * ConstVector(unknowns.data() + first);
    motion.E[e].leftCols<3>().setIdentity();
    if (end.dofs < 6) continue;
    const Turning& turn = J_angular_[end.point];
    const Vector3d mean_arm = turn.B * shape->r0[e];
    const Vector3d arm_change = ConstVector(unknowns.data() + first + 3).cross(mean_arm);
    change += end.sign * arm_change;
    motion.arm[e] = shape->r0[e] + share_ * arm_change;
    motion.E[e].rightCols<3>() = -turn.B * cross_matrix(mean_arm);
  }
  motion.d1 = shape->d0 + change;
  shape->d = shape->d0 + share_ * change;
  return motion;
}

ImplicitStep::LinkPull ImplicitStep::pull_link(const Link& link, const Vector3d& d1, Shape* shape,
                                               const Unknowns& unknowns) {
  LinkPull at_link;
  auto& [P, pull, gradient, value] = at_link;
  const Vector3d& d = shape->d;
  const double compliance = shape->compliance;
  const double lambda = unknowns[link.unknown];
  switch (link.kind) {
    case Kind::kRod:
      shape->force = lambda * d;
      P.diagonal().setConstant(lambda);
      pull.col(0) = d;
      gradient.col(0) = d1;
      value[0] = 0.5 * d1.squaredNorm() - shape->target + compliance * lambda;
      note_row(*shape, 0, std::abs(value[0]) / std::sqrt(2.0 * shape->target));
      break;
    case Kind::kBall:
      for (int k = 0; k < 3; ++k)
        shape->force[k] = shape->is_left_out[k] ? 0.0 : unknowns[link.unknown + k];
      value = d1 - shape->offset.head<3>() + compliance * shape->force;
      for (int k = 0; k < 3; ++k) note_row(*shape, to_index(k), std::abs(value[k]));
      break;
    case Kind::kGeneral:
      break;  // done by evaluate_general()
    case Kind::kSpring: {
      const double s1 = d1.norm();
      const double s = (1.0 - share_) * shape->d0.norm() + share_ * s1;
      const Vector3d n1 = s1 > 0.0 ? Vector3d(d1 / s1) : Vector3d(Vector3d::UnitX());
      const Vector3d n = s > 0.0 ? Vector3d(d / s) : Vector3d(Vector3d::UnitX());
      shape->force = lambda * n;
      if (s > 0.0) P = lambda / s * (Matrix3d::Identity() - n * n1.transpose());
      pull.col(0) = n;
      gradient.col(0) = n1;
      value[0] = compliance * lambda + s1 - shape->target;
      break;
    }
  }
  if (link.kind == Kind::kRod && shape->is_left_out[0]) {
    shape->force.setZero();
    P.setZero();
  }
  return at_link;
}

void ImplicitStep::evaluate_link(const Link& link, Shape* shape, const Unknowns& unknowns) {
  double* const values = lu_.values().data();
  const LinkMotion motion = move_link(link, shape, unknowns);
  const auto& [P, pull, gradient, value] = pull_link(link, motion.d1, shape, unknowns);
  const double compliance = shape->compliance;

  // Effect of the force on each end: [1; C r ×].
  Eigen::Matrix<double, 6, 3> H[2];
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    if (end.dofs == 0) continue;
    H[e].topRows<3>().setIdentity();
    Vector(residual_.data() + end.unknown) -= s_ * end.sign * shape->force;
    if (end.dofs < 6) continue;
    Turning& turn = J_angular_[end.point];
    H[e].bottomRows<3>() = turn.C * cross_matrix(motion.arm[e]);
    Vector(residual_.data() + end.unknown + 3) -=
        s_ * end.sign * (H[e].bottomRows<3>() * shape->force);
    turn.torque += end.sign * motion.arm[e].cross(shape->force);
  }

  std::size_t slot = link.slot;
  const double scale = shape->scale;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& row = link.ends[e];
    const double* const left = left_.data() + std::max(row.unknown, 0);
    for (std::size_t f = 0; f < 2; ++f) {
      const End& column = link.ends[f];
      if (row.dofs == 0 || column.dofs == 0) continue;
      Eigen::Matrix<double, 6, 6> K = Eigen::Matrix<double, 6, 6>::Zero();
      // The force of a ball joint does not depend on the positions of its ends.
      if (link.kind != Kind::kBall) {
        Eigen::Matrix<double, 3, 6> PE = Eigen::Matrix<double, 3, 6>::Zero();
        PE.leftCols<3>() = P;
        if (column.dofs == 6) PE.rightCols<3>() = P * motion.E[f].rightCols<3>();
        const double weight = -s_ * share_ * row.sign * column.sign;
        K.topRows<3>() = weight * PE;
        if (row.dofs == 6) K.bottomRows<3>().noalias() = weight * H[e].bottomRows<3>() * PE;
      }
      if (e == f && row.dofs == 6) {
        const Turning& turn = J_angular_[row.point];
        K.bottomRightCorner<3, 3>() += (s_ * share_ * row.sign) * turn.C *
                                       cross_matrix(shape->force) * motion.E[e].rightCols<3>();
      }
      const double* const right = right_.data() + column.unknown;
      for (int i = 0; i < row.dofs; ++i)
        for (int j = 0; j < column.dofs; ++j)
          values[slots_[slot++]] += left[i] * K(i, j) * right[j];
    }
    for (int i = 0; i < row.dofs; ++i) {
      for (int k = 0; k < link.rows; ++k) {
        // s of the column cancels 1/s of its scale.
        const double column = -row.sign * H[e].row(i).dot(pull.col(k));
        const double entry = row.sign * gradient.col(k).dot(motion.E[e].col(i));
        const bool is_in = !shape->is_left_out[k];
        values[slots_[slot++]] += is_in ? left[i] * column * scale : 0.0;
        values[slots_[slot++]] += is_in ? scale * entry * right_[row.unknown + i] : 0.0;
      }
    }
  }
  for (int k = 0; k < link.rows; ++k) {
    const double diagonal = scale * compliance * right_[link.unknown];
    const bool is_in = !shape->is_left_out[k];
    values[slots_[slot++]] += is_in ? diagonal : 1.0;
    residual_[link.unknown + k] = is_in ? value[k] : 0.0;
  }
}

// Evaluates a rod whose ends do not rotate; a fast path of evaluate_link().
void ImplicitStep::evaluate_rod(const Link& link, Shape* shape, const Unknowns& unknowns) {
  double* const values = lu_.values().data();
  Vector3d change = Vector3d::Zero();
  for (const End& end : link.ends)
    change += end.sign * (end.dofs > 0 ? Vector3d(ConstVector(unknowns.data() + end.unknown))
                                       : shift_[end.point]);
  const Vector3d d1 = shape->d0 + change;
  shape->d = shape->d0 + share_ * change;
  const bool is_in = !shape->is_left_out[0];
  const double lambda = is_in ? unknowns[link.unknown] : 0.0;
  shape->force = lambda * shape->d;
  const double value = 0.5 * d1.squaredNorm() - shape->target + shape->compliance * lambda;
  note_row(*shape, 0, std::abs(value) / std::sqrt(2.0 * shape->target));

  const double scale = is_in ? shape->scale : 0.0;
  std::size_t slot = link.slot;
  for (const End& row : link.ends) {
    if (row.dofs == 0) continue;
    const double left = left_[row.unknown];
    for (const End& column : link.ends) {
      if (column.dofs == 0) continue;
      const double K =
          -share_ * s_ * row.sign * column.sign * lambda * left * right_[column.unknown];
      for (int k = 0; k < 3; ++k) values[slots_[slot++]] += K;
    }
    const double weight = row.sign * left * scale;
    for (int k = 0; k < 3; ++k) {
      values[slots_[slot++]] += -weight * shape->d[k];
      values[slots_[slot++]] += weight * d1[k];
    }
    Vector(residual_.data() + row.unknown) -= (s_ * row.sign) * shape->force;
  }
  values[slots_[slot]] += is_in ? scale * shape->compliance * right_[link.unknown] : 1.0;
  residual_[link.unknown] = is_in ? value : 0.0;
}

}  // namespace constraint_sim::engine
