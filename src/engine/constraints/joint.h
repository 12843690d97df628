#pragma once

#include "constraint_sim/joint.h"
#include "constraint_sim/row.h"
#include "engine/constraints/anchor_pair.h"

namespace constraint_sim::engine {

inline constexpr int kMaxJointRows = 3;

/// One step as a joint sees it.
struct JointStep {
  double t;             ///< simulated time at its start [s]
  double h;             ///< its length [s]
  double beta;          ///< Baumgarte's share unless the joint has its own
  double closing_time;  ///< [s] in which an error left by an edit is closed; 0: by Baumgarte
};

/// Writes the rows of a joint, given as Row{}, with their targets and returns how many, at most
/// kMaxJointRows. Sets the bias of `state`, and ends it when its time is over.
int prepare_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
                  JointState& state, Row* rows);

/// Reads back what the solved rows have done, at the positions after the step.
void read_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
                const Row* rows, int count, JointState& state);

/// error, error_rate and reached_rate from where the bodies are and how they move.
void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, JointState& state);

/// The same for a joint just added or mended, or whose bodies were set; what it is off by is then
/// to be closed.
/// `t` is simulated time [s].
void begin_joint(const Joint& joint, const BodyState& a, const BodyState& b, double t,
                 JointState& state);

/// Elastic energy [J]; 0 unless a spring.
double elastic_energy(const Joint& joint, const JointState& state);

/// ∫ amplitude·sin(2π·frequency·t + phase) + bias dt from t to t + h [m].
double motor_travel(const Motor& motor, double t, double h);

/// Whether the joint promises to keep its value: springs do not.
bool is_rigid(const Joint& joint);

}  // namespace constraint_sim::engine
