// Joints with the rows of their kind as part of an ImplicitStep.

#include <cmath>

#include "engine/methods/cross_matrix.h"
#include "engine/methods/implicit_step.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

ImplicitStep::VectorSlopes::Slope ImplicitStep::VectorSlopes::of(VectorRef u,
                                                                 std::size_t end) const {
  if (u.kind == VectorKind::kSeparation) return d;
  if (u.kind == (end == 0 ? VectorKind::kAxisA : VectorKind::kAxisB)) return axes[u.axis];
  return Slope::Zero();
}

void ImplicitStep::JacobianSlopes::add(VectorRef u, VectorRef other, const JointVectors& v,
                                       const VectorSlopes& slopes, std::size_t end) {
  const Vector3d f = v[other];
  const Slope df = slopes.of(other, end);
  switch (u.kind) {
    case VectorKind::kSeparation:
      force += df;
      torque_A -= cross_matrix(v.r_A) * df;
      torque_B += cross_matrix(v.r_B) * df;
      (end == 0 ? torque_A : torque_B) += (end == 0 ? 1.0 : -1.0) * cross_matrix(f) * slopes.arm;
      break;
    case VectorKind::kAxisA:
      torque_A += cross_matrix(v[u]) * df - cross_matrix(f) * slopes.of(u, end);
      break;
    case VectorKind::kAxisB:
      torque_B += cross_matrix(v[u]) * df - cross_matrix(f) * slopes.of(u, end);
      break;
    case VectorKind::kWorldAxis:
      break;
  }
}

// of both ends, where the bodies are at the start of the step and fixed points are now
void ImplicitStep::place_axes(const EquationsOfMotion& equations, const Link& link,
                              std::array<Matrix3d, 2>* axes) const {
  if (!info(link.joint).has_frames) return;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    (*axes)[e] = link.frames[e];
    if (end.dofs == 6) (*axes)[e] = turn_[end.point].R0 * link.frames[e];
    if (end.dofs == 0) (*axes)[e] = equations.fixed_axes(end.point) * link.frames[e];
  }
}

JointVectors ImplicitStep::start_of(const Shape& shape) {
  JointVectors vectors;
  vectors.r_A = shape.r0[0];
  vectors.r_B = shape.r0[1];
  vectors.d = shape.d0;
  vectors.axes_A = shape.axes0[0];
  vectors.axes_B = shape.axes0[1];
  return vectors;
}

// what each row is scaled by: 1/√(J M⁻¹ Jᵀ), with the mean of the inertias
void ImplicitStep::begin_general(const Link& link, Shape* shape) const {
  const JointVectors vectors = start_of(*shape);
  for (int k = 0; k < link.rows; ++k) {
    const Jacobian J = jacobian(info(link.joint).row[at(k)], vectors);
    double sum = 0.0;
    for (std::size_t e = 0; e < 2; ++e) {
      const End& end = link.ends[e];
      if (end.dofs == 0) continue;
      sum += J.j3.squaredNorm() / mass_[end.point];
      if (end.dofs == 6) sum += (e == 0 ? J.j2 : J.j4).squaredNorm() / inertia_[end.point].mean();
    }
    shape->row_scale[k] = sum > 0.0 ? 1.0 / std::sqrt(sum) : 1.0;
  }
}

// Where the vectors of a joint are at the end of the step and where its forces are taken, and how
// those at the end move with the bodies.
void ImplicitStep::move_general(const Link& link, const Shape& shape, const Unknowns& unknowns,
                                GeneralMotion* motion) const {
  const bool has_frames = info(link.joint).has_frames;
  JointVectors& end_vectors = motion->at_end;
  Vector3d change = Vector3d::Zero();  // of d
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    VectorSlopes& slopes = motion->slopes[e];
    Vector3d& arm = e == 0 ? end_vectors.r_A : end_vectors.r_B;
    Matrix3d& axes = e == 0 ? end_vectors.axes_A : end_vectors.axes_B;
    arm = shape.r0[e];
    if (has_frames) axes = shape.axes1[e];
    if (end.dofs == 0) {
      change += end.sign * shift_[end.point];
      continue;
    }
    change += end.sign * ConstVector(unknowns.data() + end.unknown);
    slopes.d.leftCols<3>() = end.sign * Matrix3d::Identity();
    if (end.dofs < 6) continue;
    const Turning& turn = turn_[end.point];
    const ConstVector w(unknowns.data() + end.unknown + 3);
    const auto advance = [&](const Vector3d& start, VectorSlopes::Slope* slope) -> Vector3d {
      const Vector3d mean = turn.B * start;
      slope->rightCols<3>() = -turn.B * cross_matrix(mean);
      return start + w.cross(mean);
    };
    arm = advance(shape.r0[e], &slopes.arm);
    change += end.sign * (arm - shape.r0[e]);
    slopes.d.rightCols<3>() = end.sign * slopes.arm.rightCols<3>();
    for (int k = 0; has_frames && k < 3; ++k)
      axes.col(k) = advance(shape.axes0[e].col(k), &slopes.axes[at(k)]);
  }
  end_vectors.d = shape.d0 + change;
  motion->at_force = between(start_of(shape), end_vectors, share_);
}

// As evaluate_link(). Forces and torques are λ times the Jacobian at the vectors of the time at
// which forces are taken: for the midpoint rule at their means, the discrete gradient.
void ImplicitStep::evaluate_general(const Link& link, Shape* shape, const Unknowns& unknowns) {
  GeneralMotion motion;
  move_general(link, *shape, unknowns, &motion);
  GeneralForces forces;
  shape->swing = {};
  for (int k = 0; k < link.rows; ++k) {
    const RowForm row = info(link.joint).row[at(k)];
    forces.J[at(k)] = jacobian(row, motion.at_force);
    forces.value[k] = value(row, motion.at_end) - shape->offset[k];
    note_row(*shape, at(k), std::abs(forces.value[k]) * (row.has_separation() ? 1.0 : link.radius));
    const double lambda = shape->is_left_out[at(k)] ? 0.0 : unknowns[at(link.unknown + k)];
    const Jacobian& J = forces.J[at(k)];
    forces.force += lambda * J.j3;
    forces.torque[0] += lambda * J.j2;
    forces.torque[1] += lambda * J.j4;
    shape->swing[0] += (lambda * J.j2).norm();
    shape->swing[1] += (lambda * J.j4).norm();
    for (std::size_t f = 0; f < 2; ++f) {
      if (link.ends[f].dofs == 0) continue;
      const VectorSlopes& slopes = motion.slopes[f];
      JacobianSlopes slope;
      slope.add(row.u, row.v, motion.at_force, slopes, f);
      slope.add(row.v, row.u, motion.at_force, slopes, f);
      forces.slopes[f].add(lambda, slope);
      forces.gradient[at(k)][f] = motion.at_end[row.v].transpose() * slopes.of(row.u, f) +
                                  motion.at_end[row.u].transpose() * slopes.of(row.v, f);
    }
  }
  shape->force = forces.force;
  shape->d = motion.at_force.d;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    if (end.dofs == 0) continue;
    Vector(residual_.data() + end.unknown) -= s_ * end.sign * forces.force;
    if (end.dofs < 6) continue;
    Turning& turn = turn_[end.point];
    Vector(residual_.data() + end.unknown + 3) -= s_ * (turn.C * forces.torque[e]);
    turn.torque += forces.torque[e];
  }
  write_general(link, *shape, forces);
}

// The blocks of a joint in the derivative, in the order of its slots, and the residuals of its
// rows.
void ImplicitStep::write_general(const Link& link, const Shape& shape,
                                 const GeneralForces& forces) {
  double* const values = lu_.values().data();
  std::size_t slot = link.slot;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& row = link.ends[e];
    if (row.dofs == 0) continue;
    const double* const left = left_.data() + row.unknown;
    const Matrix3d C = row.dofs == 6 ? turn_[row.point].C : Matrix3d(Matrix3d::Zero());
    for (std::size_t f = 0; f < 2; ++f) {
      const End& column = link.ends[f];
      if (column.dofs == 0) continue;
      const JacobianSlopes& slopes = forces.slopes[f];
      Eigen::Matrix<double, 6, 6> K;
      K.topRows<3>() = (-s_ * share_ * row.sign) * slopes.force;
      K.bottomRows<3>() = (-s_ * share_) * C * (e == 0 ? slopes.torque_A : slopes.torque_B);
      const double* const right = right_.data() + column.unknown;
      for (int i = 0; i < row.dofs; ++i)
        for (int j = 0; j < column.dofs; ++j)
          values[slots_[slot++]] += left[i] * K(i, j) * right[j];
    }
    std::array<Eigen::Matrix<double, 6, 1>, kMaxJointRows> columns;
    for (int k = 0; k < link.rows; ++k) {
      const Jacobian& J = forces.J[at(k)];
      columns[at(k)].head<3>() = -row.sign * J.j3;
      columns[at(k)].tail<3>() = -(C * (e == 0 ? J.j2 : J.j4));
    }
    for (int i = 0; i < row.dofs; ++i) {
      for (int k = 0; k < link.rows; ++k) {
        const double scale = shape.is_left_out[at(k)] ? 0.0 : shape.row_scale[k];
        values[slots_[slot++]] += left[i] * columns[at(k)][i] * scale;
        values[slots_[slot++]] +=
            scale * forces.gradient[at(k)][e][i] * right_[at(row.unknown + i)];
      }
    }
  }
  for (int k = 0; k < link.rows; ++k) {
    const bool is_in = !shape.is_left_out[at(k)];
    values[slots_[slot++]] += is_in ? 0.0 : 1.0;
    residual_[at(link.unknown + k)] = is_in ? forces.value[k] : 0.0;
  }
}

}  // namespace constraint_sim::engine
