#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/forms.h"
#include "engine/constraints/law.h"

namespace constraint_sim::engine {

// What acts on a coordinate q one way or up to a limit, as the event-driven method has it: limits,
// Coulomb friction, a motor by velocity with a force limit. Each is a force that jumps where q̇
// passes a rate, from most to least as q̇ grows, and takes any value between while q̇ stays there:
//   friction    ±f          at q̇ = 0
//   motor       ±max_force  at q̇ = ζ
//   limits      0 … ∞ at the lower one, −∞ … 0 at the upper one, at the rate of the limit
// So a coordinate is either held at one of these rates, which is a rigid row with bounds on its
// force, or has a constant force. With that said for all of them the joint is an ordinary one.

/// At which rate a coordinate is held.
enum class Hold : char {
  kNone,
  kUpper,  ///< at its upper limit
  kLower,
  kStill,  ///< by friction, at 0
  kDrive,  ///< by its motor, at ζ
};

struct OneSidedLaw {
  std::size_t joint = 0;  ///< among those of the island
  int coordinate = 0;     ///< of the joint; 0 of a distance joint, whose length it is
  bool is_distance = false;
  ScalarForm form;
  double zero = 0.0;  ///< as CoordinateLaw
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  double limit_force = std::numeric_limits<double>::infinity();  ///< most of a limit [N or N m]
  double restitution = 0.0;
  double friction = 0.0;  ///< [N or N m]
  double drive = 0.0;     ///< most force of the motor [N or N m]
  SoftLaw soft;           ///< what acts beside
  int function = 0;       ///< of the joint: where forces along q are

  double limit(bool upper_one) const { return upper_one ? upper : lower; }
};

/// What of a law acts how.
struct OneSidedState {
  Hold hold = Hold::kNone;
  signed char slip = 0;   ///< sign of q̇, where friction slips
  signed char drive = 0;  ///< sign of q̇ − ζ, where the motor is at its limit
  signed char yield = 0;  ///< +1: the upper limit gives way at its force, −1: the lower one

  bool is_at(bool upper_one) const {
    return hold == (upper_one ? Hold::kUpper : Hold::kLower) || yield == (upper_one ? 1 : -1);
  }
  bool operator==(const OneSidedState& other) const {
    return hold == other.hold && slip == other.slip && drive == other.drive && yield == other.yield;
  }
};

/// Whether a joint has such a law.
bool has_one_sided_law(const Joint& joint);
/// Whether all such laws of a joint are of the above. Not: springs and servos with a force limit,
/// and motors with one that go to a position.
bool is_switchable(const Joint& joint);

/// Adds the laws of a joint.
void add_one_sided_laws(const Joint& joint, std::size_t index, std::vector<OneSidedLaw>* laws);

/// The constant force of a coordinate that is not held [N or N m].
double constant_force(const OneSidedLaw& law, const OneSidedState& state);

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
