#pragma once

#include <Eigen/Core>
#include <array>

#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/joint.h"

namespace constraint_sim::engine {

inline constexpr int kMaxJointRows = 6;
/// A number per row of a joint, in the order of the table of kinds, then per coordinate; the rest
/// is zero.
using RowVector = Eigen::Matrix<double, kMaxJointRows, 1>;

/// Motion of a coordinate to a new position of its motor, set while the coordinate moved. Its error
/// goes from the values at `since` to rest at the position.
struct MovingStart {
  double since = 0.0;         ///< simulated time at which the position was set [s]
  double duration = 0.0;      ///< [s]; 0: no such motion
  double offset = 0.0;        ///< error [m or rad]
  double rate = 0.0;          ///< rate of the error [m/s or rad/s]
  double acceleration = 0.0;  ///< second derivative of the error [m/s² or rad/s²]
};

/// Errors that a joint closes, as they were at time `since`. The errors of a coordinate in `moving`
/// had a rate then; all others were at rest.
struct ErrorsToClose {
  double since = 0.0;  ///< simulated time at which closing began [s]
  /// Error of each row and coordinate [m or rad]. Zero for rows that are closed by moving the frame
  /// on B, with `shift` and `turn`.
  RowVector offset = RowVector::Zero();
  /// Pose, relative to the frame on B, that met the rows: shift of the anchor in B's frame [m], and
  /// rotation vector in the joint's frame on B [rad]. For ball joints and kinds that keep axes
  /// aligned.
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  double coupling = 0.0;  ///< error of the coupling, in the unit of the first coordinate
  /// Motions that replace `offset` of their coordinates.
  std::array<MovingStart, kMaxCoordinates> moving;
};

/// Numbers from which the next step of a joint continues, and which no user reads.
struct JointMemory {
  /// Impulses of the rows, for warm starting [N s or N m s].
  RowVector impulse = RowVector::Zero();
  /// Impulse of the coupling along its first coordinate, for warm starting [N s or N m s].
  double coupling_impulse = 0.0;
  ErrorsToClose to_close;  ///< errors that are closed while `closing`
  /// Remaining share of the turn `to_close` where impulses remove a share per step.
  double closing_share = 0.0;
  double initial_error = 0.0;  ///< `error` when the joint was last added or edited [m]
};

/// State of a joint with the memory of its solver.
struct JointData : JointState, JointMemory {};

class World;
/// Returns the state of a joint of a world with the memory of its solver.
const JointData& joint_data(const World& world, JointId joint);

}  // namespace constraint_sim::engine
