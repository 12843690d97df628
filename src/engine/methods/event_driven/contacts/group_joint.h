#pragma once

#include <array>
#include <cstddef>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/math/list.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

/// Function of a joint that a law acts on, or kOfCoupling.
inline int function_of(const OneSidedLaw& law) {
  return law.is_coupling ? kOfCoupling : law.function;
}

/// Forces or impulses of a joint.
struct GroupForces {
  RowVector rows = RowVector::Zero();  ///< per row and coordinate of its kind
  double coupling = 0.0;

  double& at(int function) { return function == kOfCoupling ? coupling : rows[function]; }
  double& at(const OneSidedLaw& law) { return at(function_of(law)); }
  void add(double weight, const GroupForces& other) {
    rows += weight * other.rows;
    coupling += weight * other.coupling;
  }
};

/// State of a joint of a contact group in a step.
struct GroupJointState {
  int index;             ///< index in the world
  std::size_t a, b;      ///< indices in GroupBodies
  bool has_rows = true;  ///< rows of the kind; else coordinates only
  bool is_broken = false;
  bool was_saturated = false;  ///< value reported by the last step
  bool is_at_end = false;      ///< a winch at the end of its travel, in this interval
  PrescribedMotion motion{};   ///< prescribed motion in this interval
  ErrorsToClose to_close{};    ///< errors that it closes; of laws that ended their motion, less
  CoupledTerms terms{};        ///< terms of a coupling, with indices in GroupJoints
  std::array<int, 2> term_angles{-1, -1};  ///< index in the angles, per term; -1: no angle
  double constant = 0.0;                   ///< value that a coupling keeps
  GroupForces impulse{};                   ///< accumulated in the step
  GroupForces impact{};                    ///< part of `impulse` by impacts at one moment
  GroupForces reference{};                 ///< admissible forces of rows, as references of λ
};

/// Joint of a contact group.
struct GroupJoint : GroupJointState {
  Joint joint;

  /// Whether a load may break the joint.
  bool may_break() const {
    return !is_broken && (joint.break_force > 0.0 || joint.break_torque > 0.0);
  }
};

/// Coordinate of a joint of a contact group, length of a distance joint or one-sided coupling, on
/// which a law acts.
struct GroupCoordinate {
  std::size_t joint;           ///< index in GroupJoints
  OneSidedLaw law;             ///< form, one-sided law and soft law of the coordinate
  bool is_prescribed = false;  ///< held by a motor without force limit
  bool is_one_sided = false;
  OneSidedState state;
  MotorRate motor{};  ///< demand in this interval; of laws with a drive
  int angle = -1;     ///< index in the angles; -1: no angle
  /// Position where friction or a drive began to hold the coordinate, or from which a motor brakes
  /// [m or rad].
  double held = 0.0;
  double held_at = 0.0;  ///< time when the hold began, simulated [s]
  /// Displacement of a yielding limit of a length since the step began [m].
  double yield_displacement = 0.0;
  double reference = 0.0;  ///< admissible force, as reference of λ [N or N m]
  double braking = 0.0;    ///< deceleration, see CoordinateState
  double until = 0.0;      ///< end of braking by the motor, simulated [s]

  /// Whether a spring, damper, servo or law at its bound may exert a force.
  bool has_free_force() const {
    return !law.soft.is_none() || law.has_servo() || constant_force(law, state) != 0.0;
  }
};

/// Adds the coordinates of joint j on which a law acts, and says in the joint whether it has rows.
void add_coordinates(std::size_t j, GroupJoint* of, List<OneSidedLaw>* scratch,
                     List<GroupCoordinate>* coordinates);

}  // namespace constraint_sim::engine
