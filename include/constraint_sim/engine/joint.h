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

/// Kind of a joint. d: from anchor A to anchor B; x, y, z: axes of the joint's frames on A and B.
enum class JointKind : std::uint8_t {
  kDistance,     ///< ‖d‖ fixed or limited, by DistanceJoint: a rod, a rope, a strut or a spring
  kBall,         ///< anchors coincide; rotation is free
  kHinge,        ///< anchors coincide and z axes are collinear; turns about z
  kSlider,       ///< frames keep their orientation, and anchor B stays on the z axis; moves along z
  kCylindrical,  ///< a slider that turns about z
  kPlanar,     ///< anchor B in A's x-y plane, z axes parallel; moves in the plane and turns about z
  kUniversal,  ///< anchors coincide, z axes at right angles; turns about both z axes
  kWeld,       ///< frames coincide; nothing is free
  kPointOnLine,   ///< anchor B on A's z axis; rotation is free
  kPointOnPlane,  ///< anchor B in A's x-y plane; rotation is free
  kParallel,      ///< z axes parallel; turns about z, and moves freely
  kFreeDistance,  ///< holds nothing; ‖d‖ is a free coordinate that may have laws
  kGear,          ///< q₁ + ratio q₂ of the first coordinates of two other joints stays constant
  kPulley,  ///< ℓ₁ + ratio ℓ₂ of the lengths of two joints of kind kFreeDistance stays constant
  kScrew,        ///< a cylindrical joint that moves along z by `pitch` per turn
  kCustom,       ///< a scalar equation of another package, given by `custom`
  kCustomForce,  ///< holds nothing; a force of another package acts between the anchors
};
/// Number of kinds before kCustom, which need no other package.
inline constexpr auto kOwnJointKindCount = static_cast<std::size_t>(JointKind::kCustom);
inline constexpr auto kJointKindCount = static_cast<std::size_t>(JointKind::kCustomForce) + 1;

/// Settings of a joint of kind kDistance: a rod, a rope or strut between limits, or a spring about
/// `length`, which may act one way. C = ‖d‖ − length [m].
struct DistanceJoint {
  std::optional<double> length;  ///< [m] ≥ 0; left out: the distance when added; 0: a ball joint
  /// Limits of ‖d‖ [m] ≥ 0. With either limit the anchors are free between the limits.
  double min_length = 0.0;
  double max_length = std::numeric_limits<double>::infinity();
  /// Spring by frequency of the undamped oscillation [Hz] and damping ratio [1]. add_joint()
  /// converts both to stiffness and damping with the effective mass. 0: rigid.
  double frequency = 0.0;
  double damping_ratio = 0.0;
  /// Spring by stiffness [N/m] and damping [N s/m], instead of frequency and damping ratio.
  double stiffness = 0.0;
  double damping = 0.0;
  /// Whether the spring only pulls: F = k (‖d‖ − length) + c ḋ where ‖d‖ > length and F > 0, else
  /// 0. Needs a spring, and excludes limits and a force limit.
  bool one_sided = false;

  bool is_limited() const {
    return min_length > 0.0 || max_length < std::numeric_limits<double>::infinity();
  }
  bool is_soft() const { return frequency > 0.0 || stiffness > 0.0 || damping > 0.0; }
};

/// Motor of a length or a coordinate. By default it is a velocity motor: it drives the rate to
/// ζ(t) = bias + amplitude·sin(2π·frequency·t + phase), with simulated time t. ζ > 0 lengthens, or
/// turns positively about the axis; with ζ = 0 the motor holds the present value. By `position` a
/// motor moves a coordinate there, rigidly within the world's closing time or as a servo (spring
/// and damper about `position`). By `force` it acts with a constant force. Kind kDistance has
/// velocity motors alone.
struct Motor {
  double bias = 0.0;                 ///< [m/s or rad/s]
  double amplitude = 0.0;            ///< [m/s or rad/s]
  double frequency = 0.0;            ///< [Hz] ≥ 0
  double phase = 0.0;                ///< [rad]
  double max_force = 0.0;            ///< [N or N m] ≥ 0; 0: no limit
  double timeout = 0.0;              ///< simulated time until bias returns to 0 [s]; 0: never
  std::optional<double> position{};  ///< target of the coordinate [m or rad]
  /// Servo by frequency [Hz] and damping ratio [1]. When added, both are converted to
  /// `servo_stiffness` and `servo_damping` with the effective mass while the joint's own rows hold.
  /// With frequency and stiffness 0 the position is held rigidly.
  double servo_frequency = 0.0;
  double servo_damping_ratio = 1.0;
  double servo_stiffness = 0.0;   ///< [N/m or N m/rad] ≥ 0
  double servo_damping = 0.0;     ///< [N s/m or N m s/rad] ≥ 0
  std::optional<double> force{};  ///< constant force [N or N m]

  bool is_moving() const { return bias != 0.0 || amplitude != 0.0; }
  bool is_servo() const { return position && (servo_frequency > 0.0 || servo_stiffness > 0.0); }
  /// Whether the motor prescribes the coordinate rigidly, by velocity or position.
  bool is_rigid() const { return !force && !is_servo(); }
};

/// Laws of a free coordinate q of a joint: a translation [m] or an angle [rad]. Kind kDistance has
/// its laws in DistanceJoint.
struct CoordinateLaw {
  std::optional<Motor> motor;  ///< left out: no motor
  /// Limits of q [m or rad].
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  double limit_restitution = 0.0;  ///< share of the speed after an impact on a limit, [0, 1]
  double friction = 0.0;           ///< largest Coulomb friction [N or N m] ≥ 0
  double damping = 0.0;            ///< viscous damping [N s/m or N m s/rad] ≥ 0
  double stiffness = 0.0;          ///< spring about `rest` [N/m or N m/rad] ≥ 0
  double rest = 0.0;               ///< rest position of the spring [m or rad]
  /// Spring by frequency [Hz] and damping ratio [1]. When added, both are converted to stiffness
  /// and damping with the effective mass while the joint's own rows hold.
  double frequency = 0.0;
  double damping_ratio = 0.0;
  /// Value of q at the poses of the bodies when the joint is added. Left out: 0 for an angle, the
  /// displacement of the anchors for a translation.
  std::optional<double> position;

  double zero = 0.0;  ///< offset that is added to the geometric value of q; set by `position`

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

/// Coupling of a gear or pulley: q₁ + ratio q₂ = value, with the first coordinates of two existing
/// joints, whole turns counted. For gears the ratio is the teeth of 2 over the teeth of 1, negative
/// for an internal mesh; for a rack and its pinion it is ±1/radius [1/m].
struct Coupling {
  JointId first, second;
  double ratio = 1.0;           ///< units of q₁ per unit of q₂, not 0
  std::optional<double> value;  ///< [m or rad, as q₁]; left out: present value when added
  /// Whether a pulley's rope may go slack: q₁ + ratio q₂ ≤ value. Needs a ratio > 0.
  bool one_sided = false;
};

/// A constraint between two bodies, or a body and the world.
struct Joint {
  std::string name;  ///< `[A-Za-z0-9_][A-Za-z0-9_./-]*`, unique among joints
  JointKind kind = JointKind::kDistance;
  BodyId body_a = kWorldBody;
  Eigen::Vector3d anchor_a = Eigen::Vector3d::Zero();  ///< anchor in body A's frame [m]
  /// Rotation from the joint frame on A to body A's frame, unit; for kinds with axes.
  Eigen::Quaterniond frame_a = Eigen::Quaterniond::Identity();
  BodyId body_b = kWorldBody;
  Eigen::Vector3d anchor_b = Eigen::Vector3d::Zero();  ///< anchor in body B's frame [m]
  /// Rotation from the joint frame on B to body B's frame, unit. Left out: set so that the joint
  /// fits the poses of the bodies when added.
  std::optional<Eigen::Quaterniond> frame_b;
  /// Axis z of the frame on B in body B's frame, any length but 0, instead of `frame_b`.
  std::optional<Eigen::Vector3d> axis_b;
  DistanceJoint distance;  ///< for kind kDistance
  Motor motor;             ///< for kind kDistance: a velocity motor
  /// Laws of the free coordinates, JointKindInfo::coordinates of them; for kinds other than
  /// kDistance.
  std::array<CoordinateLaw, kMaxCoordinates> coordinates;
  Coupling coupling;     ///< for kinds kGear and kPulley; kScrew uses its `value` alone [m]
  double pitch = 0.0;    ///< for kind kScrew [m per turn], not 0
  CustomElement custom;  ///< for kinds kCustom and kCustomForce
  /// Share of the error removed each step, [0, 1]; left out: the world's.
  std::optional<double> baumgarte;
  double break_force = 0.0;  ///< force beyond which the joint breaks for good [N]; 0: never
  /// Torque beyond which the joint breaks for good [N m]; 0: never; not for kinds of
  /// distances, gears and pulleys.
  double break_torque = 0.0;
  bool collide_connected = false;  ///< whether the two connected bodies collide with each other
  bool enabled = true;             ///< whether the joint acts; World::set_enabled()
};

/// State of a free coordinate q.
struct CoordinateState {
  double position = 0.0;  ///< q, whole turns counted [m or rad]
  double velocity = 0.0;  ///< [m/s or rad/s]
  /// Generalized force of laws and couplings along q, mean over the step [N or N m].
  double effort = 0.0;
  double bias = 0.0;  ///< rate ζ of the motor, mean over the step [m/s or rad/s]
  double held = 0.0;  ///< position at which the motor holds q [m or rad]
  /// Deceleration of a position motor with a force limit that has lost its prescribed motion and
  /// brakes towards its position [m/s² or rad/s²]; 0: no braking.
  double braking = 0.0;
  /// Simulated time at which the bias ends [s].
  double expires_at = std::numeric_limits<double>::infinity();
};

/// State of a coupling of coordinates, in the unit of the first coordinate.
struct CouplingState {
  double value = 0.0;     ///< Σ ratio q
  double rate = 0.0;      ///< Σ ratio q̇
  double constant = 0.0;  ///< target of `value`
  /// Generalized force along the first coordinate, mean over the step [N or N m].
  double effort = 0.0;
};

/// State of a joint; updated by each step.
struct JointState {
  /// For kind kDistance ‖d‖ − length, or the excess beyond a limit [m]. For gears and pulleys the
  /// error of the coupling, in the unit of the first coordinate. For other kinds the larger of the
  /// distance between the anchors that rows hold at zero, and `angle_error` times `radius` [m].
  /// Infinity stands for an error that does not exist, where the function of a custom joint fails.
  double error = 0.0;
  double error_rate = 0.0;   ///< rate of `error` without the motor's prescribed rate [m/s]
  double angle_error = 0.0;  ///< angle between frame B and its aligned orientation [rad]
  double radius = 0.0;       ///< radius of gyration, the larger of the two dynamic bodies' [m]
  /// Mean over the step. Kind kDistance: along d [N], > 0 pushes apart, < 0 is tension. Kinds with
  /// coordinates: effort along the first [N or N m]; gears and pulleys: effort along the first
  /// coupled coordinate. Other kinds: norm of the force [N].
  double force = 0.0;
  double bias = 0.0;  ///< rate ζ of the motor, mean over the step [m/s or rad/s]
  /// Actual rate of the length or of the first coordinate [m/s or rad/s].
  double reached_rate = 0.0;
  bool saturated = false;  ///< motor at its force limit, or at the end of its travel
  bool broken = false;     ///< broken by more than `break_force` or `break_torque`; does not act
  bool closing = false;    ///< an edit left an error above 1e-6 m that is not yet closed

  std::array<CoordinateState, kMaxCoordinates> coordinates;  ///< for kinds other than kDistance
  CouplingState coupling;                                    ///< for kinds that couple coordinates

  /// ∫ζ dt since the length was set [m]: the motor adds it to `length` and the limits.
  double travel = 0.0;
  /// End of the bias of a distance joint, simulated [s].
  double expires_at = std::numeric_limits<double>::infinity();
};

/// Properties of a kind of joint.
struct JointKindInfo {
  const char* name = "";         ///< name in scene files
  bool has_frames = false;       ///< joints have frames with axes
  bool has_two_axes = false;     ///< z axes are at right angles, so that scenes give both
  bool is_free_length = false;   ///< the only coordinate is ‖d‖, and no row holds anything
  bool is_custom = false;        ///< joints need functions of another package
  bool couples = false;          ///< joints couple coordinates, their own or of other joints
  bool couples_joints = false;   ///< joints couple other joints: no bodies, anchors and axes
  bool couples_lengths = false;  ///< the coupled joints are of a kind with `is_free_length`
  bool has_pitch = false;        ///< joints couple their own two coordinates by a pitch
  /// Number of free coordinates with laws; 0 for kDistance, whose length has laws of its own.
  int coordinates = 0;
  /// Per coordinate, whether it is an angle [rad]; else it is a translation [m].
  std::array<bool, kMaxCoordinates> is_angle{};
};

/// Returns the properties of a kind.
const JointKindInfo& info(JointKind kind);

/// Name as in scene files: `distance`, `ball`, `hinge` ...
inline const char* name(JointKind kind) { return info(kind).name; }

/// Returns the kind with this name(), or none.
std::optional<JointKind> joint_kind_named(std::string_view name);

/// Returns the names of all kinds but distance, with a comma before each.
std::string names_of_further_kinds();

/// Returns the settings of a joint of kind kDistance, nullptr for another kind.
inline const DistanceJoint* if_distance(const Joint& joint) {
  return joint.kind == JointKind::kDistance ? &joint.distance : nullptr;
}
inline DistanceJoint* if_distance(Joint& joint) {
  return joint.kind == JointKind::kDistance ? &joint.distance : nullptr;
}

/// Returns all kinds that need no other package.
const std::array<JointKind, kOwnJointKindCount>& joint_kinds();

/// Returns a frame with its z axis along `axis`, of any length but 0, turned by the least angle.
/// Throws std::invalid_argument naming `axis_a` where the axis has no direction.
Eigen::Quaterniond frame_along(const Eigen::Vector3d& axis);

/// Returns the spring that only pulls for a rope with `max_length` and stiffness, damping or
/// frequency: `max_length` becomes its length. Throws std::invalid_argument naming `max_length`.
DistanceJoint tension_spring(DistanceJoint rope);

/// Throws std::invalid_argument naming the invalid field and its value. Does not check that bodies
/// exist.
void validate(const Joint& joint);
void validate(const Motor& motor);
void validate(const CoordinateLaw& law);

}  // namespace constraint_sim::engine
