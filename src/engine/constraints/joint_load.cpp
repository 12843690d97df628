#include "engine/constraints/joint_load.h"

#include <cmath>

#include "engine/constraints/coupling.h"
#include "engine/constraints/custom_code.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

// Whether the impulses of a step break a joint of a kind other than kDistance.
bool breaks(const Joint& joint, const BodyState& a, const BodyState& b, const RowVector& impulse,
            double h, const JointState& state) {
  if (joint.break_force == 0.0 && joint.break_torque == 0.0) return false;
  const double coupling = info(joint.kind).couples_joints ? state.coupling.effort : 0.0;
  return load_of(joint, a, b, impulse / h, coupling).breaks(joint);
}

}  // namespace

bool is_overloaded(const Joint& joint, const BodyState& a, const BodyState& b,
                   const RowVector& impulse, double h, const JointState& state) {
  if (!has_length(joint.kind)) return breaks(joint, a, b, impulse, h, state);
  return joint.break_force > 0.0 && std::abs(state.force) > joint.break_force;
}

void note_force(const Joint& joint, const RowVector& impulse, double h, JointState& state) {
  const JointForms& kind = forms(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i)
    state.coordinates[i].effort = impulse[kind.rows + i] / h;
  Eigen::Vector3d separation = impulse.head<3>();
  for (int k = kind.separation_rows; k < 3; ++k) separation[k] = 0.0;
  state.force = kind.coordinates > 0 ? state.coordinates[0].effort : separation.norm() / h;
  if (info(joint.kind).couples_joints) state.force = state.coupling.effort;
}

void add_own_coupling(const Joint& joint, double impulse, RowVector* done) {
  if (!info(joint.kind).has_pitch) return;
  const int along = forms(joint.kind).rows;
  (*done)[along] += impulse;
  (*done)[along + 1] -= lead(joint) * impulse;
}

Jacobian custom_wrench(const Joint& joint, const BodyState& a, const BodyState& b, double t) {
  const JointVectors vectors(joint, a, b);
  return joint.custom.code->wrench(t, vectors, JointMotion(vectors, a, b));
}

World::JointWrench wrench_of(const Joint& joint, const BodyState& a, const BodyState& b,
                             const RowVector& impulse, double h) {
  const JointVectors vectors(joint, a, b);
  const JointForms& kind = forms(joint.kind);
  Jacobian sum;
  for (int k = 0; k < kind.rows + kind.coordinates; ++k)
    sum = combined(1.0, sum, impulse[k] / h, jacobian(kind.function[k], vectors));
  const Eigen::Matrix3d to_joint = kind.has_frames ? Eigen::Matrix3d(vectors.axes_B.transpose())
                                                   : b.orientation.toRotationMatrix().transpose();
  return {to_joint * sum.j3, to_joint * (sum.j4 - vectors.r_B.cross(sum.j3))};
}

JointLoad load_of(const Joint& joint, const BodyState& a, const BodyState& b, const RowVector& rows,
                  double coupling) {
  if (info(joint.kind).couples_joints) return {std::abs(coupling), 0.0};
  if (has_length(joint.kind)) return {std::abs(rows[0]), 0.0};
  RowVector all = rows;
  add_own_coupling(joint, coupling, &all);
  const World::JointWrench wrench = wrench_of(joint, a, b, all, 1.0);
  return {wrench.force.norm(), wrench.torque.norm()};
}

double elastic_energy(const Joint& joint, const JointState& state) {
  if (!acts(joint, state)) return 0.0;
  if (const auto* distance = if_distance(joint))
    return elastic_energy(distance->stiffness, state.error, joint.motor.max_force);
  double energy = 0.0;
  for (std::size_t i = 0; i < to_index(info(joint.kind).coordinates); ++i)
    energy += elastic_energy(joint.coordinates[i], state.coordinates[i].position);
  return energy;
}

}  // namespace constraint_sim::engine
