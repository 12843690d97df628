#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/forms.h"
#include "engine/constraints/law.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// What acts on a coordinate q one way or up to a limit, as the event-driven method has it: limits,
// Coulomb friction, motors, servos and springs with a force limit. All but the last are a force
// that jumps where q̇ passes a rate, from most to least as q̇ grows, and takes any value between
// while q̇ stays there:
//   friction    ±f          at q̇ = 0
//   motor       ±max_force  at q̇ = ζ
//   limits      0 … ∞ at the lower one, −∞ … 0 at the upper one, at the rate of the limit
// So a coordinate is either held at one of these rates, which is a rigid row with bounds on its
// force, or has a constant force. With that said for all of them the joint is an ordinary one.
//
// A motor that goes to a position g holds q on its course c(t), ζ = ċ, until that takes more than
// max_force. From then on the course is lost, and it goes to g as one who has to stop there:
//   ζ = −sign(q − g) √(2 b |q − g|)
// It pushes with all its force until q̇ = ζ, and then holds q on q = g ± ½ b (t₁ − t)², which ends
// at rest in g at t₁; so nothing overshoots that the force can stop. b is what half of max_force
// does to q where the course is lost, while the other motors with a force limit hold theirs.
//
// A servo or a spring with a force limit is −K(q − R) − C q̇ within ±max_force. That is continuous:
// it either follows this law, or is a constant force.

/// At which rate a coordinate is held.
enum class Hold : char {
  kNone,
  kUpper,  ///< at its upper limit
  kLower,
  kStill,  ///< by friction, at 0
  kDrive,  ///< by its motor, at ζ
  kBrake,  ///< the same, of one that has lost its course and comes to rest at its position
};

/// What a servo or a spring with a force limit does.
enum class Servo : char {
  kNone,     ///< is not there
  kFollows,  ///< its law
  kMost,     ///< +max_force
  kLeast,    ///< −max_force
};

struct OneSidedLaw {
  std::size_t joint = 0;  ///< among those of the island
  int coordinate = 0;     ///< of the joint; 0 of a distance joint, whose length it is
  bool is_distance = false;
  ScalarForm form;
  double zero = 0.0;  ///< as CoordinateLaw
  double lower = -kInfinity;
  double upper = kInfinity;
  double limit_force = kInfinity;  ///< most of a limit [N or N m]
  double restitution = 0.0;
  double friction = 0.0;       ///< [N or N m]
  double drive = 0.0;          ///< most force of the motor [N or N m]
  std::optional<double> goal;  ///< to which that goes [m or rad]
  SoftLaw soft;                ///< what acts beside
  SoftLaw servo;               ///< what acts beside up to a limit; of a length without its R
  double servo_most = 0.0;     ///< that limit; 0: none [N or N m]
  int function = 0;            ///< of the joint: where forces along q are

  double limit(bool upper_one) const { return upper_one ? upper : lower; }
};

/// What of a law acts how.
struct OneSidedState {
  Hold hold = Hold::kNone;
  signed char slip = 0;   ///< sign of q̇, where friction slips
  signed char drive = 0;  ///< sign of q̇ − ζ, where the motor is at its limit
  signed char yield = 0;  ///< +1: the upper limit gives way at its force, −1: the lower one
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

/// Whether a joint has such a law.
bool has_one_sided_law(const Joint& joint);
/// Whether all such laws of a joint are of the above. Not: a spring that also has limits, and a
/// force limit for both.
bool is_switchable(const Joint& joint);

/// Adds the laws of a joint.
void add_one_sided_laws(const Joint& joint, std::size_t index, List<OneSidedLaw>* laws);

/// The constant force of a coordinate that is not held, without that of a servo [N or N m].
double constant_force(const OneSidedLaw& law, const OneSidedState& state);

/// Where a servo acts about, and how that moves; of a coordinate it stays.
inline Prescribed rest_of(const OneSidedLaw& law, const Prescribed& length) {
  return law.is_distance ? length : Prescribed{law.servo.R, 0.0, 0.0};
}
/// What a servo would do without a limit, and the rate of that. `rest` as rest_of() has it.
template <class Reading>
double servo_force(const OneSidedLaw& law, const Reading& now, const Prescribed& rest) {
  return -law.servo.K * (now.q - rest.value) - law.servo.C * (now.rate - rest.rate);
}
template <class Reading>
double servo_force_rate(const OneSidedLaw& law, const Reading& now, const Prescribed& rest) {
  return -law.servo.K * (now.rate - rest.rate) -
         law.servo.C * (now.acceleration - rest.acceleration);
}
/// What it does.
template <class Reading>
double clamped_servo_force(const OneSidedLaw& law, const Reading& now, const Prescribed& rest) {
  return std::clamp(servo_force(law, now, rest), -law.servo_most, law.servo_most);
}

/// The rate of a motor that has lost its course, where it goes on with `braking`, and the
/// acceleration of a coordinate that has this rate.
Prescribed rate_to_goal(double goal, double braking, double q);
/// The same of one that brakes and is there after this time [s]; `braking` < 0 from below.
inline Prescribed rate_until(double goal, double braking, double left) {
  return {goal, -braking * left, braking};
}

/// Bounds of the force of a coordinate that is held, without soft laws. `zeta` is what the motor
/// asks for; `rate` what the coordinate is held at [m/s or rad/s].
struct ForceBounds {
  double least = 0.0, most = 0.0;
};
ForceBounds force_bounds(const OneSidedLaw& law, Hold hold, double rate, double zeta);

/// The joint with its laws, `count` of them, as the states say: rigid rows and constant forces.
/// What a row is held at is up to JointState. False where nothing of the joint acts.
bool with_rows_switched(const OneSidedLaw* laws, const OneSidedState* states, std::size_t count,
                        Joint* joint);

}  // namespace constraint_sim::engine
