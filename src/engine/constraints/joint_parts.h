#pragma once

#include "engine/constraints/joint.h"

namespace constraint_sim::engine {

// Functions shared by joint.cpp, joint_rows.cpp and joint_course.cpp.

/// Sets the mean bias of a step, and returns the motor as it acts throughout the step.
Motor drive(const DistanceJoint& distance, const JointStep& step, Motor motor, JointState& state);
/// Sets the mean bias of a coordinate, and returns its motor as it acts throughout the step.
Motor drive(const CoordinateLaw& law, const JointStep& step, CoordinateState* state);

/// Returns the frame on B at the start or the end of a step. Without a closing time Baumgarte
/// closes the joint, and only the rotation uses a moving frame.
MovingFrame frame_in(const Joint& joint, const JointStep& step, const JointData& state,
                     bool at_end);

/// Sets forces and efforts of a joint of a kind other than kDistance from the impulses per row and
/// coordinate.
void note_force(const Joint& joint, const RowVector& impulse, double h, JointState& state);

/// Adds the impulse of the row of a screw to the impulses along its coordinates.
void add_own_coupling(const Joint& joint, double impulse, RowVector* done);

/// Measures the joint after a step, and updates closing and breaking, from the impulses of its
/// rows.
void finish(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
            double zeta, const RowVector& impulse, JointData& state);

}  // namespace constraint_sim::engine
