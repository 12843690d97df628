#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/forms.h"
#include "engine/constraints/law.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/joint_data.h"
#include "engine/model/zero_tolerances.h"

namespace constraint_sim::engine {

// Laws on a coordinate q whose force has one sign or a bound, in event-driven integration: limits,
// Coulomb friction, motors, servos or springs with a force limit, and springs that only pull. The
// value of a one-sided coupling has an upper limit, too. Servos and springs aside, each
// force jumps where q̇ passes a rate, and has any value between while q̇ stays there:
//   friction    ±f          at q̇ = 0
//   motor       ±max_force  at q̇ = ζ
//   limits      0 … ∞ at the lower, −∞ … 0 at the upper, at the rate of the limit
// A coordinate is held at such a rate by a bounded rigid row, or has a constant force.

/// Rate at which a coordinate is held, if any.
enum class Hold : char {
  kNone,
  kUpper,  ///< at the upper limit
  kLower,
  kStill,  ///< at rate 0, by friction
  kDrive,  ///< at ζ, by the motor
  /// At ζ: a position motor whose force limit broke its prescribed motion decelerates the
  /// coordinate. The braking rate ends at zero at the motor's target.
  kBrake,
};

/// State of a servo or a spring with a force limit: −K (q − R) − C q̇, within ±max_force. The force
/// is continuous, so it either follows this law or is constant. A spring that only pulls follows
/// the law where q > R and the force is < 0, and else has no force.
enum class Servo : char {
  kNone,     ///< no servo
  kFollows,  ///< below its force limit
  kMost,     ///< force +max_force
  kLeast,    ///< force −max_force
  kSlack,    ///< no force; the length is at most R
  kRetracts  ///< no force; the length is above R and shrinks faster than the damper allows to pull
};

/// The one-sided and limited laws of one coordinate, length or coupling of a joint.
struct OneSidedLaw {
  std::size_t joint = 0;  ///< index of the joint in the island
  int coordinate = 0;     ///< coordinate of the joint; 0 for the length of a distance joint
  bool is_distance = false;
  /// Value of the coupling of `joint`, without a form; its upper limit is CouplingState::constant.
  bool is_coupling = false;
  bool only_pulls = false;  ///< `servo` is a spring that only pulls, without a force limit
  ScalarForm form;
  double zero = 0.0;  ///< CoordinateLaw::zero
  double lower = -kInfinity;
  double upper = kInfinity;
  double limit_force = kInfinity;  ///< largest force of a limit [N or N m]
  double restitution = 0.0;
  double friction = 0.0;       ///< largest friction [N or N m]
  double drive = 0.0;          ///< force limit of the motor [N or N m]
  std::optional<double> goal;  ///< target of a position motor [m or rad]
  SoftLaw soft;                ///< soft law without force limit
  SoftLaw servo;               ///< servo or spring with a force limit; R is not used for a length
  double servo_most = 0.0;     ///< force limit of `servo`; 0: no servo [N or N m]
  int function = 0;            ///< index of the coordinate in JointForms::function

  double limit(bool upper_one) const { return upper_one ? upper : lower; }
  /// Distance by which a coordinate was beyond its limits when it began to close errors; of a
  /// length or without a goal, the error itself. > 0: beyond the upper limit.
  double beyond_at_start(const ErrorsToClose& errors) const {
    const double offset = errors.offset[function];
    if (!goal) return offset;
    const MovingStart& moving = errors.moving[static_cast<std::size_t>(coordinate)];
    const double start = *goal + (moving.duration > 0.0 ? moving.offset : offset);
    return std::max(start - upper, 0.0) + std::min(start - lower, 0.0);
  }
  bool has_servo() const { return servo_most > 0.0 || only_pulls; }
  /// Whether the law may hold the coordinate anywhere, as friction and motors do, not only at a
  /// limit.
  bool may_hold_anywhere() const { return friction > 0.0 || drive > 0.0; }
  /// Whether the law is a rope: the upper limit of a length or of the lengths of a pulley.
  bool is_rope() const { return is_distance || is_coupling; }
};

/// State of a OneSidedLaw between events.
struct OneSidedState {
  Hold hold = Hold::kNone;
  signed char slip = 0;   ///< sign of q̇ while friction slips, else 0
  signed char drive = 0;  ///< sign of q̇ − ζ while the motor is at its force limit, else 0
  signed char yield = 0;  ///< +1: the upper limit yields at its force limit, −1: the lower limit
  Servo servo = Servo::kNone;

  bool is_at(bool upper_one) const {
    return hold == (upper_one ? Hold::kUpper : Hold::kLower) || yield == (upper_one ? 1 : -1);
  }
  bool operator==(const OneSidedState& other) const {
    return hold == other.hold && slip == other.slip && drive == other.drive &&
           yield == other.yield && servo == other.servo;
  }
  /// Whether a motor or a servo is at its force limit.
  bool is_saturated() const {
    return drive != 0 || yield != 0 || servo == Servo::kMost || servo == Servo::kLeast;
  }
};

/// Whether a joint has a one-sided or limited law.
bool has_one_sided_law(const Joint& joint);
/// Whether event-driven integration can treat the joint. A spring with both length limits and a
/// force limit is excluded.
bool is_switchable(const Joint& joint);

/// Adds the one-sided and limited laws of a joint. `index`: OneSidedLaw::joint.
void add_one_sided_laws(const Joint& joint, std::size_t index, List<OneSidedLaw>* laws);

/// Returns the constant force of a coordinate that is not held, without servos [N or N m].
double constant_force(const OneSidedLaw& law, const OneSidedState& state);

/// Returns the rest position of a servo and its motion; for a coordinate it is constant.
inline Prescribed rest_of(const OneSidedLaw& law, const Prescribed& length) {
  return law.is_distance ? length : Prescribed{law.servo.R, 0.0, 0.0};
}
/// Returns the force of a servo without its limit; servo_force_rate() is its rate. `rest` is from
/// rest_of().
template <class Reading>
double servo_force(const OneSidedLaw& law, const Reading& now, const Prescribed& rest) {
  return -law.servo.K * (now.q - rest.value) - law.servo.C * (now.rate - rest.rate);
}
template <class Reading>
double servo_force_rate(const OneSidedLaw& law, const Reading& now, const Prescribed& rest) {
  return -law.servo.K * (now.rate - rest.rate) -
         law.servo.C * (now.acceleration - rest.acceleration);
}
/// Distance from the natural length, rest_of(), within which a length counts as natural [m].
inline constexpr double kAtNaturalLength = 1e-10;
/// Returns the force of a servo within its limit.
template <class Reading>
double clamped_servo_force(const OneSidedLaw& law, const Reading& now, const Prescribed& rest) {
  if (law.only_pulls)
    return now.q - rest.value >= -kAtNaturalLength ? std::min(servo_force(law, now, rest), 0.0)
                                                   : 0.0;
  return std::clamp(servo_force(law, now, rest), -law.servo_most, law.servo_most);
}

/// Whether a coordinate at distance `off` from a goal, with this rate, comes to rest at the goal by
/// the deceleration `braking`, to kTouching.
inline bool brakes_to_goal(double off, double rate, double braking) {
  return std::abs(off + 0.5 * rate * std::abs(rate) / braking) <= kTouching;
}
/// Returns the target rate of a position motor that lost its prescribed motion, which needed more
/// than max_force: ζ = −sign(q − g) √(2 b |q − g|), with the acceleration at this rate. The motor
/// pushes with max_force until q̇ = ζ, and then holds q = g ± ½ b (t₁ − t)², which rests at g at t₁
/// without overshoot. b (`braking`) is the acceleration of q by half of max_force when the motion
/// is lost, while other motors hold theirs. The rate is zero within kTouching of the goal.
Prescribed rate_to_goal(double goal, double braking, double q);
/// Returns the rate of a braking motor that rests at `goal` after `left` [s]; `braking` < 0 from
/// below.
inline Prescribed rate_until(double goal, double braking, double left) {
  return {goal, -braking * left, braking};
}

/// Returns the motion of a braking motor from `rate` on; at rest it stays at the goal.
inline Prescribed braking_from(double goal, double rate, double braking) {
  if (std::abs(rate) <= kResting) return {goal, 0.0, 0.0};
  return rate_until(goal, std::copysign(braking, -rate), std::abs(rate) / braking);
}

/// Bounds of the force on a held coordinate, without soft laws. `at`: motion in which the
/// coordinate is held; `zeta`: motion that the motor demands. The force of a motor may have either
/// sign where both rates differ by kResting or less. Friction opposes a motion that is about to
/// start, and braking until it has ended.
struct ForceBounds {
  double least = 0.0, most = 0.0;
};
ForceBounds force_bounds(const OneSidedLaw& law, Hold hold, const Prescribed& at,
                         const Prescribed& zeta);

/// Replaces the `count` laws of the joint by the rigid rows and constant forces of their states.
/// Targets of rows are taken from the state of the joint. Returns false where the joint does not
/// act.
bool with_rows_switched(const OneSidedLaw* laws, const OneSidedState* states, std::size_t count,
                        Joint* joint);

}  // namespace constraint_sim::engine
