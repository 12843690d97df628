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

#include "constraint_sim/engine/custom.h"
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
  kParallel,      ///< z axes parallel; turns about z, and moves freely
  kFreeDistance,  ///< nothing; ‖d‖ is free, measured, and may have laws
  kGear,    ///< q₁ + ratio q₂ of the first coordinates of two other joints stays what it is
  kPulley,  ///< the same of the lengths of two joints of kind kFreeDistance
  kScrew,   ///< a cylindrical joint that moves along z by `pitch` a turn
  kCustom,  ///< one equation of another package, as `custom` has it
  kCustomForce,  ///< nothing; a force of another package acts between the anchors
};
/// Those before kCustom need no other package.
inline constexpr std::size_t kOwnJointKindCount = 15;
inline constexpr std::size_t kJointKindCount = 17;

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

/// The bias ζ of a joint: the rate of its length, or of another coordinate, is driven to
/// ζ(t) = bias + amplitude·sin(2π·frequency·t + phase), t simulated time. Positive lengthens, or
/// turns positively about the axis; with ζ = 0 the joint holds the value it has reached.
struct Motor {
  double bias = 0.0;       ///< [m/s or rad/s]
  double amplitude = 0.0;  ///< [m/s or rad/s]
  double frequency = 0.0;  ///< [Hz] ≥ 0
  double phase = 0.0;      ///< [rad]
  double max_force = 0.0;  ///< [N or N m] ≥ 0; 0: no limit
  double timeout = 0.0;    ///< [s] of simulated time until bias returns to 0; 0: never

  bool is_moving() const { return bias != 0.0 || amplitude != 0.0; }
};

/// That of a translation or an angle, which can also go to a position, exactly within the world's
/// closing time or as a servo by a spring about it, or act with a constant force.
struct CoordinateMotor : Motor {
  std::optional<double> position;  ///< [m or rad]
  /// Of a servo, by frequency [Hz] and damping ratio [1], turned into the next two when added, by
  /// the effective mass with the joint's own rows held; both 0: exactly.
  double servo_frequency = 0.0;
  double servo_damping_ratio = 1.0;
  double servo_stiffness = 0.0;  ///< [N/m or N m/rad] ≥ 0
  double servo_damping = 0.0;    ///< [N s/m or N m s/rad] ≥ 0
  std::optional<double> force;   ///< [N or N m]

  bool is_servo() const { return position && (servo_frequency > 0.0 || servo_stiffness > 0.0); }
  /// Whether the motor holds the coordinate with any force that this takes.
  bool is_rigid() const { return !force && !is_servo(); }
};

/// What acts on a free coordinate q of a joint: a translation [m] or an angle [rad], of kinds other
/// than kDistance.
struct CoordinateLaw {
  std::optional<CoordinateMotor> motor;  ///< left out: free
  /// Limits of q; beyond them it is pushed back, and thrown back with this share of its speed.
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  double limit_restitution = 0.0;  ///< [0, 1]
  double friction = 0.0;           ///< Coulomb's, the most it holds with [N or N m] ≥ 0
  double damping = 0.0;            ///< viscous [N s/m or N m s/rad] ≥ 0
  double stiffness = 0.0;          ///< of a spring about `rest` [N/m or N m/rad] ≥ 0
  double rest = 0.0;               ///< [m or rad]
  /// The spring by frequency [Hz] and damping ratio [1] instead, turned into stiffness and damping
  /// when added, by the effective mass with the joint's own rows held.
  double frequency = 0.0;
  double damping_ratio = 0.0;
  /// What q reads as the bodies lie when the joint is added; left out: 0 of an angle, where the
  /// anchors are of a translation.
  std::optional<double> position;

  double zero = 0.0;  ///< what q reads where axes and anchors say 0; set by `position`

  bool is_limited() const {
    return lower > -std::numeric_limits<double>::infinity() ||
           upper < std::numeric_limits<double>::infinity();
  }
  bool is_none() const {
    return !motor && !is_limited() && friction == 0.0 && damping == 0.0 && stiffness == 0.0 &&
           frequency == 0.0 && damping_ratio == 0.0 && !position && zero == 0.0;
  }
};

inline constexpr std::size_t kMaxCoordinates = 3;

/// What a gear or a pulley joins, and how: q₁ + ratio q₂ = value, with the first coordinates of two
/// joints that are there already, whole turns counted. Of gears the ratio is the teeth of 2 over
/// those of 1, negative of an internal mesh; of a rack and its pinion it is ±1/radius [1/m].
struct Coupling {
  JointId first, second;
  double ratio = 1.0;           ///< in units of q₁ per unit of q₂, not 0
  std::optional<double> value;  ///< [m or rad, as q₁]; left out: as they read when it is added
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
  DistanceJoint distance;  ///< of kind kDistance
  Motor motor;             ///< of kind kDistance
  /// Of other kinds, as many as coordinates() tells.
  std::array<CoordinateLaw, kMaxCoordinates> coordinates;
  Coupling coupling;                ///< of kinds kGear and kPulley; of kScrew its `value` alone [m]
  double pitch = 0.0;               ///< of kind kScrew [m a turn], not 0
  CustomElement custom;             ///< of kinds kCustom and kCustomForce
  std::optional<double> baumgarte;  ///< share of the error removed each step, [0, 1]; the world's
  double break_force = 0.0;         ///< [N] beyond which the joint breaks for good; 0: never
  double break_torque = 0.0;        ///< [N m], the same; not of kind kDistance
  bool collide_connected = false;   ///< whether the two bodies may touch
  bool enabled = true;              ///< else it does not act; World::set_enabled()
};

inline constexpr int kMaxJointRows = 6;
/// A number for each row of a joint, in the order of the table of kinds, then for each coordinate;
/// the others are zero.
using RowVector = Eigen::Matrix<double, kMaxJointRows, 1>;

/// A free coordinate now.
struct CoordinateState {
  double position = 0.0;  ///< q, whole turns counted [m or rad]
  double velocity = 0.0;  ///< [m/s or rad/s]
  double effort = 0.0;    ///< of what acts along it, mean over the step [N or N m]
  double bias = 0.0;      ///< asked for by its motor, mean over the step [m/s or rad/s]
  double held = 0.0;      ///< where the motor holds it [m or rad]
  /// With what a motor brakes that had not the force for its course, on its way to its position
  /// [m/s² or rad/s²]; 0: on its course.
  double braking = 0.0;
  double expires_at = std::numeric_limits<double>::infinity();  ///< end of the bias, simulated [s]
};

/// The coupling of a joint of a kind that couples() coordinates, in the unit of the first one.
struct CouplingState {
  double value = 0.0;     ///< Σ ratio q now
  double rate = 0.0;      ///< of that
  double constant = 0.0;  ///< what the value is to be
  double effort = 0.0;    ///< along the first coordinate, mean over the step [N or N m]
  double impulse = 0.0;   ///< the same, to warm start [N s or N m s]
  double offset = 0.0;    ///< what there was to close at `closing_since`
};

/// What a joint does now; brought up to date by each step.
struct JointState {
  /// ‖d‖ − length, or beyond a limit [m]. Of other kinds the larger of the distance that has to be
  /// zero, such as ‖d‖, and `angle_error` times `radius` [m]. Of gears and pulleys what the sum is
  /// off by, in the unit of the first coordinate.
  double error = 0.0;
  double error_rate = 0.0;   ///< rate of `error`, motion asked for by the motor taken out [m/s]
  double angle_error = 0.0;  ///< by which frame B has to turn to where frame A asks for it [rad]
  double radius = 0.0;       ///< of gyration, the larger of the two dynamic bodies' [m]
  /// Mean over the step: along d [N], > 0 pushes apart, < 0 is tension; of kinds with coordinates
  /// the effort along the first [N or N m], of gears and pulleys along the first that they couple;
  /// of others the length of the force [N].
  double force = 0.0;
  double bias = 0.0;          ///< ζ asked for, mean over the step [m/s]
  double reached_rate = 0.0;  ///< rate of the distance that was reached [m/s]
  bool saturated = false;     ///< the motor is at its force limit, or at the end of its travel
  bool broken = false;        ///< after more than `break_force`; no longer acts
  bool closing = false;       ///< an edit left an error above 1e-6 m that is not yet closed

  std::array<CoordinateState, kMaxCoordinates> coordinates;  ///< of kinds other than kDistance
  CouplingState coupling;                                    ///< of kinds that couple

  double travel =
      0.0;  ///< ∫ζ dt since the joint was added: what the motor has added to the length [m]
  double closing_since = 0.0;  ///< simulated [s]
  /// What there was to close then: the error of each row [m or rad], of a ball joint on a B that
  /// cannot turn d in world axes; of others that are closed by their frame only of coordinates.
  RowVector closing_offset = RowVector::Zero();
  /// Of ball joints and those that keep axes aligned, where the frame on B would have met the rows:
  /// this far from its anchor, in B's frame [m], and turned by this vector, in the joint's frame on
  /// B [rad].
  Eigen::Vector3d closing_shift = Eigen::Vector3d::Zero();
  Eigen::Vector3d closing_turn = Eigen::Vector3d::Zero();
  double closing_share = 0.0;  ///< of that turn, where it goes by a share a step
  /// Of a distance joint, end of the bias, simulated [s].
  double expires_at = std::numeric_limits<double>::infinity();
  double initial_error = 0.0;             ///< when last looked for what is to be closed [m]
  RowVector impulse = RowVector::Zero();  ///< of its rows, to warm start [N s or N m s]
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

/// How many free coordinates with laws it has; 0 of a distance joint, whose length has its own.
int coordinates(JointKind kind);
/// Whether this one is an angle [rad]; else a translation [m].
bool is_angle(JointKind kind, int coordinate);

/// Whether the z axes of both frames are at right angles, so that both have to be given.
bool has_two_axes(JointKind kind);

/// Whether it couples coordinates of other joints, so that it has no bodies, anchors and axes of
/// its own.
bool couples_joints(JointKind kind);
/// The same of lengths alone, of joints that are free_length().
bool couples_lengths(JointKind kind);
/// Whether it couples its own two coordinates by a pitch.
bool has_pitch(JointKind kind);
/// Whether it couples any coordinates, of other joints or its own.
bool couples(JointKind kind);

/// Whether its one coordinate is the length ‖d‖, and nothing is held.
bool is_free_length(JointKind kind);
/// That kind: `distance` with `free: true` in scene files.
JointKind free_length();

/// Whether functions of another package are needed for it.
bool is_custom(JointKind kind);

/// All kinds that need no other package.
const std::array<JointKind, kOwnJointKindCount>& joint_kinds();

/// A frame with its z axis along this vector of any length but 0, turned by the least angle. Throws
/// std::invalid_argument naming `axis_a` where it has no direction.
Eigen::Quaterniond frame_along(const Eigen::Vector3d& axis);

/// Throws std::invalid_argument naming the field and value that cannot be. Bodies are not looked
/// up.
void validate(const Joint& joint);
void validate(const Motor& motor);
void validate(const CoordinateMotor& motor);
void validate(const CoordinateLaw& law);

}  // namespace constraint_sim::engine
