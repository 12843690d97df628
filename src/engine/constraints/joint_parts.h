#pragma once

#include "engine/constraints/joint.h"

namespace constraint_sim::engine {

// What joint.cpp, joint_rows.cpp and joint_course.cpp share.

/// Sets the mean bias of a step, and returns the motor as it acts throughout it.
Motor drive(const DistanceJoint& distance, const JointStep& step, Motor motor, JointState& state);
/// The same of a coordinate.
Motor drive(const CoordinateLaw& law, const JointStep& step, CoordinateState* state);

/// The frame on B at the start or the end of a step. By a share of the error a step only the turn
/// goes by the frame.
MovingFrame frame_in(const Joint& joint, const JointStep& step, const JointState& state,
                     bool at_end);

/// Of the force of a joint that is no distance joint, by what each row and coordinate has done.
void note_force(const Joint& joint, const RowVector& impulse, double h, JointState& state);

/// Adds what the row of a screw did, which acts along coordinates of its own.
void add_own_coupling(const Joint& joint, double impulse, RowVector* done);

/// What is left to do once it is known what the rows have done.
void finish(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
            double zeta, const RowVector& impulse, JointState& state);

}  // namespace constraint_sim::engine
