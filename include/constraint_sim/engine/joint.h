#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// What a joint holds, and what it leaves free. d: from anchor A to anchor B; x, y, z: axes of the
/// joint's frames on A and B.
enum class JointKind : std::uint8_t {
  kDistance,      ///< ‖d‖ as DistanceJoint has it: a rod, a rope, a strut or a spring
  kBall,          ///< both anchors in one point; rotation is free
  kHinge,         ///< both anchors in one point and both z axes along one line; turns about z
  kSlider,        ///< the frames keep their orientation and the anchors the z axis; moves along z
  kCylindrical,   ///< a slider that turns about z
  kPlanar,        ///< anchor B in A's x-y plane, z axes parallel; moves in it and turns about z
  kUniversal,     ///< both anchors in one point, z axes at right angles; turns about both
  kWeld,          ///< both frames in one place; nothing is free
  kPointOnLine,   ///< anchor B on A's z axis; rotation is free
  kPointOnPlane,  ///< anchor B in A's x-y plane; rotation is free
};
inline constexpr std::size_t kJointKindCount = 10;

/// Settings of a joint of kind kDistance, which holds the distance of the two anchors: as a rod, or
/// between limits (rope, strut), or as a spring about `length`. C = ‖d‖ − length in metres.
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
  JointKind kind = JointKind::kDistance;
  BodyId body_a = kWorldBody;
  Eigen::Vector3d anchor_a = Eigen::Vector3d::Zero();  ///< in body A's frame [m]
  /// Joint frame on A to body A's frame, unit; for kinds with axes.
  Eigen::Quaterniond frame_a = Eigen::Quaterniond::Identity();
  BodyId body_b = kWorldBody;
  Eigen::Vector3d anchor_b = Eigen::Vector3d::Zero();  ///< in body B's frame [m]
  /// The same on B; left out: as it has to be with the bodies as they lie when it is added.
  std::optional<Eigen::Quaterniond> frame_b;
  /// z axis of the frame on B in body B's frame, any length but 0, instead of `frame_b`.
  std::optional<Eigen::Vector3d> axis_b;
  DistanceJoint distance;           ///< of kind kDistance
  Motor motor;                      ///< of kind kDistance
  std::optional<double> baumgarte;  ///< share of the error removed each step, [0, 1]; the world's
  double break_force = 0.0;         ///< [N] beyond which the joint breaks for good; 0: never
  bool collide_connected = false;   ///< whether the two bodies may touch
};

inline constexpr int kMaxJointRows = 6;
/// A number for each row of a joint, in the order of the table of kinds; the others are zero.
using RowVector = Eigen::Matrix<double, kMaxJointRows, 1>;

/// What a joint does now; brought up to date by each step.
struct JointState {
  /// ‖d‖ − length, or beyond a limit [m]. Of other kinds the larger of the distance that has to be
  /// zero, such as ‖d‖, and `angle_error` times `radius` [m].
  double error = 0.0;
  double error_rate = 0.0;   ///< rate of `error`, motion asked for by the motor taken out [m/s]
  double angle_error = 0.0;  ///< by which frame B has to turn to where frame A asks for it [rad]
  double radius = 0.0;       ///< of gyration, the larger of the two dynamic bodies' [m]
  /// Mean over the step [N]: along d, > 0 pushes apart, < 0 is tension; of other kinds its length.
  double force = 0.0;
  double bias = 0.0;          ///< ζ asked for, mean over the step [m/s]
  double reached_rate = 0.0;  ///< rate of the distance that was reached [m/s]
  bool saturated = false;     ///< the motor is at its force limit, or at the end of its travel
  bool broken = false;        ///< torn by more than `break_force`; no longer acts
  bool closing = false;       ///< an edit left an error above 1e-6 m that is not yet closed

  double travel =
      0.0;  ///< ∫ζ dt since the joint was added: what the motor has added to the length [m]
  double closing_since = 0.0;  ///< simulated [s]
  /// What there was to close then: the error of each row [m or rad], of a ball joint d in world
  /// axes.
  RowVector closing_offset = RowVector::Zero();
  double expires_at = std::numeric_limits<double>::infinity();  ///< end of the bias, simulated [s]
  double initial_error = 0.0;             ///< when last looked for what is to be closed [m]
  RowVector impulse = RowVector::Zero();  ///< of its rows, to warm start [N s or N m s]

  /// For how long after `now` the motor keeps its bias [s]: to the bit its timeout when it was set
  /// now; negative when it ended before; infinite without a timeout.
  double time_left(const Motor& motor, double now) const {
    return expires_at == now + motor.timeout ? motor.timeout : expires_at - now;
  }
};

/// As in scene files: `distance`, `ball`, `hinge` ...
const char* name(JointKind kind);

/// The kind with this name(), or none.
std::optional<JointKind> joint_kind_named(std::string_view name);

/// Names of all kinds but distance, with a comma before each.
std::string names_of_further_kinds();

/// The settings of a joint of kind kDistance, nullptr of another.
inline const DistanceJoint* if_distance(const Joint& joint) {
  return joint.kind == JointKind::kDistance ? &joint.distance : nullptr;
}
inline DistanceJoint* if_distance(Joint& joint) {
  return joint.kind == JointKind::kDistance ? &joint.distance : nullptr;
}

/// Whether joints of this kind have frames with axes.
bool has_frames(JointKind kind);

/// Whether the z axes of both frames are at right angles, so that both have to be given.
bool has_two_axes(JointKind kind);

/// All kinds.
const std::array<JointKind, kJointKindCount>& joint_kinds();

/// A frame with its z axis along this vector of any length but 0, turned by the least angle. Throws
/// std::invalid_argument naming `axis_a` where it has no direction.
Eigen::Quaterniond frame_along(const Eigen::Vector3d& axis);

/// Throws std::invalid_argument naming the field and value that cannot be. Bodies are not looked
/// up.
void validate(const Joint& joint);
void validate(const Motor& motor);

}  // namespace constraint_sim::engine
