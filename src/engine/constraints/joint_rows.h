#pragma once

#include <array>

#include "engine/constraints/joint.h"
#include "engine/constraints/row.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

// Rows of joints for methods that advance by impulses.

/// Adds the rows of a joint with their targets to `rows`. Sets the bias of `state`, which ends with
/// its timeout.
void prepare_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                   const JointStep& step, JointData& state, List<Row>* rows);

/// Writes the Jacobians of the rows of a joint at other states of the bodies.
void joint_jacobians(const Joint& joint, const BodyState& a, const BodyState& b,
                     const JointStep& step, const JointData& state, const Row* rows, int count,
                     Jacobian* J);

/// Writes the values of the rows of the kind at other states of the bodies, with the frame at the
/// end of the step [m or rad]: the length for each row of a distance joint, 0 for rows of
/// coordinates and couplings.
void joint_values(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
                  const JointData& state, const Row* rows, int count, double* values);

/// Returns the present elongation of the spring of a row [m or rad].
double spring_stretch(const Joint& joint, const JointState& state, const Row& row);

/// Takes forces and state from the solved rows, with the bodies after the step.
void read_joint(const Joint& joint, const BodyState& a, const BodyState& b, JointStep step,
                const Row* rows, int count, JointData& state);

/// Adds the two rows of a coupling, with the Jacobians `J` of its two terms. Both rows hold value
/// and target of the whole coupling.
void prepare_coupling(const Joint& joint, const JointStep& step, const JointData& state,
                      const std::array<Jacobian, 2>& J, List<Row>* rows);

/// Returns the Jacobian of a coordinate at the start or the end of a step of impulses.
Jacobian coordinate_jacobian(const Joint& joint, const BodyState& a, const BodyState& b,
                             const JointStep& step, const JointData& state, int coordinate,
                             bool at_end);

}  // namespace constraint_sim::engine
