#include "engine/dynamics/implicit/general_links.h"

#include <cmath>

#include "engine/dynamics/implicit/custom_force_in_step.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Column = Eigen::Matrix<double, 6, 1>;

/// Row of a general joint in a step: J, gradient of its value, and residual of its equation.
struct RowInStep {
  Jacobian J;
  std::array<Gradient, 2> gradient;
  double residual = 0.0;
};

// Evaluates row k, and adds its force to the forces of the joint.
RowInStep evaluate_row(const ImplicitLink& link, int k, const JointInStep& joint, double lambda,
                       LinkInStep* state, List<SoftInStep>* softs, ImplicitSystem* system,
                       GeneralForces* forces) {
  const ScalarForm& form = forms(link.joint).function[link.function[to_index(k)]];
  const FormInStep row(form, joint, lambda);
  RowInStep result{row.J, row.gradient, 0.0};
  for (std::size_t f = 0; f < 2; ++f) forces->slopes[f].add(1.0, row.slopes[f]);
  if (k < link.rigid_rows) {
    const double start = form.is_angle ? value(form, joint.at_start) : 0.0;
    const double off = start + row.value - state->offset[k];
    result.residual = form.is_angle ? unwound(off, 0.0) : off;
    if (!state->is_redundant[to_index(k)])
      system->note_row(std::abs(result.residual) * (form.has_separation() ? 1.0 : link.radius),
                       !state->is_in(k));
  } else {
    SoftInStep& soft = (*softs)[link.soft_of(k)];
    soft.end = row.end_of(form, joint, soft.start);
    result.residual = soft.given * lambda + soft.taken * soft.end - soft.target;
  }
  forces->force += lambda * row.J.j3;
  forces->torque[0] += lambda * row.J.j2;
  forces->torque[1] += lambda * row.J.j4;
  state->swing[0] += (lambda * row.J.j2).norm();
  state->swing[1] += (lambda * row.J.j4).norm();
  return result;
}

// Adds the blocks of a joint to the derivative, in the order of its entries, and the residuals of
// its rows.
void write_joint(const ImplicitLink& link, const ImplicitMotion& motion, const LinkInStep& state,
                 const List<SoftInStep>& softs, const std::array<JacobianSlopes, 2>& slopes,
                 const std::array<RowInStep, kMaxJointRows>& rows, ImplicitSystem* system) {
  ImplicitSystem::Entries entries = system->entries_of_link(link.index);
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& end = link.ends[e];
    if (end.dofs == 0) continue;
    const double* const left = system->left(end.unknown);
    const double* const right = system->right(end.unknown);
    write_slopes(link, e, motion, slopes, *system, &entries);
    std::array<Column, kMaxJointRows> columns;
    for (int k = 0; k < link.rows; ++k)
      columns[to_index(k)] = column_of(end, e, 1.0, rows[to_index(k)].J, motion);
    for (int i = 0; i < end.dofs; ++i) {
      for (int k = 0; k < link.rows; ++k) {
        const double scale = state.is_in(k) ? state.row_scale[k] : 0.0;
        const double taken = k < link.rigid_rows ? scale : scale * softs[link.soft_of(k)].taken;
        entries.add(left[i] * columns[to_index(k)][i] * scale);
        entries.add(taken * rows[to_index(k)].gradient[e][i] * right[i]);
      }
    }
  }
  for (int k = 0; k < link.rows; ++k) {
    double diagonal = state.is_in(k) ? 0.0 : 1.0;
    if (k >= link.rigid_rows)
      diagonal = system->scale_of(to_index(link.unknown + k)) * softs[link.soft_of(k)].given;
    entries.add(diagonal);
    system->set_residual(link.unknown + k, state.is_in(k) ? rows[to_index(k)].residual : 0.0);
  }
}

}  // namespace

void evaluate_general_link(const ImplicitLink& link, const ImplicitMotion& motion,
                           const List<double>& unknowns, LinkInStep* state, List<SoftInStep>* softs,
                           ImplicitSystem* system) {
  const JointInStep joint(link, *state, motion, unknowns);
  GeneralForces forces;
  std::array<RowInStep, kMaxJointRows> rows;
  state->swing = {};
  for (int k = 0; k < link.rows; ++k) {
    const double lambda = state->is_in(k) ? unknowns[link.unknown + k] : 0.0;
    rows[to_index(k)] = evaluate_row(link, k, joint, lambda, state, softs, system, &forces);
  }
  if (link.has_custom_force) add_custom_force(link, *state, joint, motion, unknowns, &forces);
  state->force = forces.force;
  state->d = joint.at_force.d;
  for (std::size_t e = 0; e < 2; ++e)
    add_load(link.ends[e], 1.0, forces.force, forces.torque[e], motion, system);
  write_joint(link, motion, *state, *softs, forces.slopes, rows, system);
}

void add_load(const ImplicitEnd& end, double weight, const Vector3d& force, const Vector3d& torque,
              const ImplicitMotion& motion, ImplicitSystem* system) {
  const double s = motion.time().s;
  if (end.dofs == 0) return;
  system->residual_at(to_index(end.unknown)) -= s * end.sign * weight * force;
  if (end.dofs < 6) return;
  system->residual_at(to_index(end.unknown) + 3) -= s * (motion.turning(end.point).C * torque);
  system->add_torque(end.point, torque);
}

void write_slopes(const ImplicitLink& link, std::size_t e, const ImplicitMotion& motion,
                  const std::array<JacobianSlopes, 2>& slopes, const ImplicitSystem& system,
                  ImplicitSystem::Entries* entries) {
  const ImplicitEnd& row = link.ends[e];
  const Matrix3d C = row.dofs == 6 ? motion.turning(row.point).C : Matrix3d(Matrix3d::Zero());
  const double s = motion.time().s, share = motion.time().share;
  const double* const left = system.left(row.unknown);
  for (std::size_t f = 0; f < 2; ++f) {
    const ImplicitEnd& column = link.ends[f];
    if (column.dofs == 0) continue;
    Eigen::Matrix<double, 6, 6> K;
    K.topRows<3>() = (-s * share * row.sign) * slopes[f].force;
    K.bottomRows<3>() = (-s * share) * C * (e == 0 ? slopes[f].torque_A : slopes[f].torque_B);
    const double* const right = system.right(column.unknown);
    for (int i = 0; i < row.dofs; ++i)
      for (int j = 0; j < column.dofs; ++j) entries->add(left[i] * K(i, j) * right[j]);
  }
}

Eigen::Matrix<double, 6, 1> column_of(const ImplicitEnd& end, std::size_t e, double weight,
                                      const Jacobian& J, const ImplicitMotion& motion) {
  const Matrix3d C = end.dofs == 6 ? motion.turning(end.point).C : Matrix3d(Matrix3d::Zero());
  Column column;
  column.head<3>() = -end.sign * weight * J.j3;
  column.tail<3>() = -weight * (C * (e == 0 ? J.j2 : J.j4));
  return column;
}

}  // namespace constraint_sim::engine
