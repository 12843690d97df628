#include "engine/dynamics/kernels/tree_forces.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Writes the forces of the rows of a joint, from what it transmits to the child.
void write_row_forces(const TreeInInterval& in, std::size_t i, double* forces) {
  const TreeBody& body = in.tree.bodies[i];
  const TreeDynamics::Placed& at = in.dynamics.placed(i);
  const SpatialVector& transmitted = in.dynamics.transmitted(i);
  const Vector3d& on_b = body.is_a ? at.point_before : at.point;
  const Vector3d torque = transmitted.angular - on_b.cross(transmitted.linear);
  for (std::size_t k = body.first_row; k < body.end_row; ++k) {
    const TransmittedRow& row = in.tree.rows[k];
    const Vector3d& of = row.is_torque ? torque : transmitted.linear;
    double component = 0.0;
    switch (row.along) {
      case TransmittedRow::Along::kWorld:
        component = of[row.axis];
        break;
      case TransmittedRow::Along::kBefore:
        component = at.axes_before.col(row.axis).dot(of);
        break;
      case TransmittedRow::Along::kNode:
        component = at.axes.col(row.axis).dot(of);
        break;
      case TransmittedRow::Along::kAcross:
        component = in.dynamics.direction(body.first + 1)
                        .angular.cross(in.dynamics.direction(body.first).angular)
                        .dot(of);
        break;
    }
    forces[in.view.unknown[row.row]] = row.sign * component;
  }
}

/// Writes the forces of couplings and of motors that prescribe a motion: what a joint transmits
/// along a motion, less what springs and dampers do. Couplings are gone through towards their
/// sources. `left`: work, per motion.
void write_motor_forces(const TreeInInterval& in, double* left, double* forces) {
  const JointTree& tree = in.tree;
  if (tree.independent.size() == tree.motions.size()) return;
  for (std::size_t i = 0; i < tree.bodies.size(); ++i) {
    const TreeBody& body = tree.bodies[i];
    const SpatialVector& transmitted = in.dynamics.transmitted(i);
    for (std::size_t k = body.first; k < body.end; ++k)
      left[k] = in.dynamics.direction(k).dot(transmitted) - in.dynamics.force(k);
  }
  for (std::size_t c = tree.couplings.size(); c-- > 0;) {
    const TreeCoupling& coupling = tree.couplings[c];
    const double force = left[coupling.from] / coupling.from_ratio;
    left[coupling.to] -= coupling.to_ratio * force;
    forces[in.view.unknown[in.equations.coupled_rows()[coupling.coupled].row]] = force;
  }
  for (std::size_t k = 0; k < tree.motions.size(); ++k)
    if (tree.motions[k].row != kNoIndex)
      forces[in.view.unknown[tree.motions[k].row]] = tree.motions[k].sense * left[k];
}

}  // namespace

void write_transmitted_forces(const TreeInInterval& in, double* work, double* forces) {
  for (std::size_t i = 0; i < in.tree.bodies.size(); ++i) write_row_forces(in, i, forces);
  write_motor_forces(in, work, forces);
}

}  // namespace constraint_sim::engine
