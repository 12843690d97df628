#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <string>
#include <variant>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// Holds the distance of the two anchors: as a rod, or between limits (rope, strut), or as a
/// spring about `length`. C = ‖d‖ − length in metres, d from anchor A to anchor B.
struct DistanceJoint {
  std::optional<double> length;  ///< [m] ≥ 0; left out: the distance when added; 0: a ball joint
  /// [m] ≥ 0. With either limit the anchors are free between the two.
  double min_length = 0.0;
  double max_length = std::numeric_limits<double>::infinity();
  /// A spring by frequency of the undamped oscillation [Hz] and damping ratio [1], turned into
  /// stiffness and damping with the effective mass at the time of adding. 0: rigid.
  double frequency = 0.0;
  double damping_ratio = 0.0;
  /// The same spring by stiffness [N/m] and damping [N s/m] instead; not together with the above.
  double stiffness = 0.0;
  double damping = 0.0;

  bool is_limited() const {
    return min_length > 0.0 || max_length < std::numeric_limits<double>::infinity();
  }
  bool is_soft() const { return frequency > 0.0 || stiffness > 0.0 || damping > 0.0; }
};

/// Holds the two anchors in one point; rotation stays free.
struct BallJoint {};

using JointType = std::variant<DistanceJoint, BallJoint>;

/// The bias ζ of a joint: its rate is driven to ζ(t) = bias + amplitude·sin(2π·frequency·t +
/// phase), t simulated time. Positive lengthens; with ζ = 0 the joint holds the value it has
/// reached.
struct Motor {
  double bias = 0.0;       ///< [m/s]
  double amplitude = 0.0;  ///< [m/s]
  double frequency = 0.0;  ///< [Hz] ≥ 0
  double phase = 0.0;      ///< [rad]
  double max_force = 0.0;  ///< [N] ≥ 0; 0: no limit
  double timeout = 0.0;    ///< [s] of simulated time until bias returns to 0; 0: never
};

/// A constraint between two bodies, or a body and the world.
struct Joint {
  std::string name;  ///< as for bodies, unique among joints
  BodyId body_a = kWorldBody;
  Eigen::Vector3d anchor_a = Eigen::Vector3d::Zero();  ///< in body A's frame [m]
  BodyId body_b = kWorldBody;
  Eigen::Vector3d anchor_b = Eigen::Vector3d::Zero();  ///< in body B's frame [m]
  JointType type = DistanceJoint{};
  Motor motor;
  std::optional<double> baumgarte;  ///< share of the error removed each step, [0, 1]; the world's
  double break_force = 0.0;         ///< [N] beyond which the joint breaks for good; 0: never
  bool collide_connected = false;   ///< whether the two bodies may touch
};

/// What a joint does now; brought up to date by each step.
struct JointState {
  double error = 0.0;  ///< ‖d‖ − length, or beyond a limit, or ‖d‖ of a ball joint [m]
  double error_rate = 0.0;    ///< rate of `error`, motion asked for by the motor taken out [m/s]
  double force = 0.0;         ///< along d, mean over the step [N]; > 0 pushes apart, < 0 is tension
  double bias = 0.0;          ///< ζ asked for, mean over the step [m/s]
  double reached_rate = 0.0;  ///< rate of the distance that was reached [m/s]
  bool saturated = false;     ///< the motor is at its force limit, or at the end of its travel
  bool broken = false;        ///< torn by more than `break_force`; no longer acts
  bool closing = false;       ///< an edit left an error above 1e-6 m that is not yet closed

  double travel =
      0.0;  ///< ∫ζ dt since the joint was added: what the motor has added to the length [m]
  double closing_since = 0.0;  ///< simulated [s]
  /// What there was to close then: the error in x, of a ball joint d in world axes [m].
  Eigen::Vector3d closing_offset = Eigen::Vector3d::Zero();
  double expires_at = std::numeric_limits<double>::infinity();  ///< end of the bias, simulated [s]
  double initial_error = 0.0;  ///< when last looked for what is to be closed [m]
  Eigen::Vector3d impulse = Eigen::Vector3d::Zero();  ///< of its rows, to warm start [N s]

  /// For how long after `now` the motor keeps its bias [s]: to the bit its timeout when it was set
  /// now; negative when it ended before; infinite without a timeout.
  double time_left(const Motor& motor, double now) const {
    return expires_at == now + motor.timeout ? motor.timeout : expires_at - now;
  }
};

/// `distance` or `ball`, as in scene files.
const char* type_name(const JointType& type);

/// Throws std::invalid_argument naming the field and value that cannot be. Bodies are not looked
/// up.
void validate(const Joint& joint);
void validate(const Motor& motor);

}  // namespace constraint_sim::engine
