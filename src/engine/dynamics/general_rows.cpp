// Rows of general joint kinds in EquationsOfMotion, by the table of kinds, and couplings.

#include <algorithm>

#include "engine/dynamics/equations_of_motion.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

}  // namespace

// Computes the vectors of general joints, and the Jacobians of their rows.
void EquationsOfMotion::update_general() {
  for (std::size_t l = first_.general; l < first_.spring; ++l) {
    const Link& link = links_[l];
    JointVectors& vectors = vectors_[l - first_.general];
    vectors.custom = link.custom;
    vectors.r_A = arm_a_[l];
    vectors.r_B = arm_b_[l];
    vectors.d = d_[l];
    const auto axes = [&](std::size_t point, const Matrix3d& frame) -> Matrix3d {
      if (rotates(point)) return orientation_[point] * frame;
      return point < bodies_.size() ? frame : Matrix3d(inputs_.fixed_axes(point) * frame);
    };
    if (!info(link.kind).has_frames) continue;
    vectors.axes_A = axes(link.a, link.frame_a);
    vectors.axes_B = axes(link.b, inputs_.frame_b(l).axes);
  }
  update_general_rows();
  if (!coupled_.empty()) update_coupled();
}

// Computes the Jacobians of general rows from the vectors of their joints.
void EquationsOfMotion::update_general_rows() {
  for (const GeneralRow& general : general_rows_) {
    const Row& row = rows_[general.row];
    const JointVectors& vectors = vectors_[general.link - first_.general];
    const Jacobian J = jacobian(general.form, vectors);
    direction_[general.row] = J.j3;
    if (row.block_a >= 0) J_angular_[row.block_a] = J.j2;
    if (row.block_b >= 0) J_angular_[row.block_b] = J.j4;
    for (const int turn : {row.block_a, row.block_b})
      if (turn >= 0)
        M_inv_Jt_[turn].noalias() = inverse_inertia_[angular_blocks_[turn].body] * J_angular_[turn];
  }
}

void EquationsOfMotion::update_coupled() {
  for (const CoupledRow& coupled : coupled_) {
    for (const CoupledRow::Term& term : coupled.terms) {
      const Row& row = part(term.part);
      const Jacobian J = jacobian(term.form, vectors_[term.link - first_.general]);
      direction_[term.part] = term.ratio * J.j3;
      if (row.block_a >= 0) J_angular_[row.block_a] = term.ratio * J.j2;
      if (row.block_b >= 0) J_angular_[row.block_b] = term.ratio * J.j4;
      for (const int turn : {row.block_a, row.block_b})
        if (turn >= 0)
          M_inv_Jt_[turn].noalias() =
              inverse_inertia_[angular_blocks_[turn].body] * J_angular_[turn];
    }
  }
}

// ---- couplings

// The rates are those of the last stage.
double EquationsOfMotion::value_of(const CoupledRow& coupled) const {
  double sum = 0.0;
  for (const CoupledRow::Term& term : coupled.terms)
    sum += term.ratio * reading_of(term, rate_of(term.link, term.form));
  return sum - coupled.constant - inputs_.coupling_offset(coupled.row - first_coupled_row()).value;
}

void EquationsOfMotion::add_coupled_right_hand_side(const Vector3d* free, double* b) const {
  for (const CoupledRow& coupled : coupled_) {
    double& sum = b[rows_[coupled.row].unknown] = 0.0;
    for (const CoupledRow::Term& term : coupled.terms) {
      const Row& of = part(term.part);
      const std::size_t g = term.link - first_.general;
      sum -= term.ratio * gamma(term.form, vectors_[g], motions_[g]) +
             direction_[term.part].dot(free[of.b] - free[of.a]);
    }
  }
}

double EquationsOfMotion::coupled_impulse(std::size_t l) const {
  for (const CoupledRow& coupled : coupled_)
    if (coupled.link == l) return impulses_[rows_[coupled.row].unknown];
  return 0.0;
}

// Sets the forces of redundant rows to zero; their unknowns come last.
void EquationsOfMotion::clear_redundant(double* lambda) const {
  std::fill(lambda + kept_, lambda + rows_.size(), 0.0);
}

void EquationsOfMotion::move_general() {
  for (std::size_t l = first_.general; l < first_.spring; ++l)
    motions_[l - first_.general] = motion_of(l);
}

// Rates of the vectors of a general joint.
JointMotion EquationsOfMotion::motion_of(std::size_t l) const {
  const Link& link = links_[l];
  const auto spin = [&](std::size_t point) -> Vector3d {
    if (rotates(point)) return angular_velocity_[point];
    if (point < bodies_.size()) return Vector3d::Zero();
    return inputs_.fixed_angular_velocity(point);
  };
  JointMotion motion;
  motion.d_dot = d_dot(l);
  motion.d_bias = gamma_d(l);
  motion.w_A = spin(link.a);
  motion.w_B = spin(link.b);
  if (inputs_.frame_b(l).moves) {
    MovingFrame frame = inputs_.frame_b(l);
    if (!rotates(link.b))  // velocity_ of the fixed point contains the frame's rate
      frame.anchor_rate = frame.anchor_acceleration = Vector3d::Zero();
    motion.add(frame, rotates(link.b) ? orientation_[link.b] : inputs_.fixed_axes(link.b));
  }
  return motion;
}

}  // namespace constraint_sim::engine
