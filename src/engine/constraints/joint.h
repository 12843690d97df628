#pragma once

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "engine/constraints/forms.h"
#include "engine/constraints/moving_frame.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

/// Marks a row of the coupling, in place of the number of a coordinate.
inline constexpr int kOfCoupling = -2;

/// Time, length and settings of a step.
struct JointStep {
  double t;             ///< simulated time at the start [s]
  double h;             ///< duration of the step [s]
  double beta;          ///< Baumgarte's share for joints without a share of their own
  double closing_time;  ///< time in which an error left by an edit is closed [s]; 0: by Baumgarte
  /// Coordinates at the end of the step, from a method that counts turns within it. NaN or nullptr
  /// where turns were not counted.
  const double* counted = nullptr;
  /// Whether bodies move with their velocity at the end of the step, as by impulses.
  bool moves_at_end_rate = false;
};

/// Clears the impulses that would warm start the rows.
void forget_impulses(JointData* state);

/// Measures a joint that was added or repaired, or whose bodies were set; its error is closed from
/// now on. `t` is simulated time [s]; `b_turns`: whether body B moves and can turn.
void begin_joint(const Joint& joint, const BodyState& a, const BodyState& b, double t,
                 JointData& state, bool b_turns = true);

/// Measures a joint without restarting its closing.
void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& now,
                   JointData& state);

/// Returns the frame on B that meets the rows of a joint that keeps axes; it does not move where
/// they are met. Coordinates of an open joint are measured with this frame. `radius` is
/// JointState::radius.
MovingFrame frame_where_met(const Joint& joint, const BodyState& a, const BodyState& b,
                            double radius);

/// Sets the coordinates of a joint that was just added, without whole turns from earlier values.
/// For a gear or pulley `state` already has the value of the coupling.
void begin_coordinates(const Joint& joint, const BodyState& a, const BodyState& b,
                       JointState& state);

/// Whether the joint is rigid, not a spring of kind kDistance.
inline bool is_rigid(const Joint& joint) {
  const DistanceJoint* const distance = if_distance(joint);
  return distance == nullptr || !distance->is_soft();
}

/// Whether the joint is rigid, without springs, limits, friction and force limits.
bool is_always_rigid(const Joint& joint);

/// Whether the joint is enabled and not broken.
inline bool acts(const Joint& joint, const JointState& state) {
  return joint.enabled && !state.broken;
}

/// Whether each error of a joint is within tolerance of 0, or of its prescribed value while the
/// joint closes errors, as exact integration needs.
bool fits(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
          const JointData& state);

/// Returns the frame on B at the start or the end of a step. Without a closing time Baumgarte
/// closes the joint, and only the rotation uses a moving frame.
MovingFrame frame_in(const Joint& joint, const JointStep& step, const JointData& state,
                     bool at_end);

/// Measures the joint after a step, and updates closing and breaking, from the impulses of its
/// rows.
void finish(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
            double zeta, const RowVector& impulse, JointData& state);

/// Takes forces and state of a step, with the bodies after it. `impulse`: per row and coordinate,
/// along d for a distance joint [N s]; `zeta`: the present bias [m/s].
void read_integrated_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                           const JointStep& step, const RowVector& impulse, double zeta,
                           JointData& state);

/// Returns the coordinate for the value of its form, with whole turns nearest to `reference` for an
/// angle.
double reading(const ScalarForm& form, double value, double zero, double reference);

}  // namespace constraint_sim::engine
