#pragma once

#include <cstddef>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/dynamics/turned_angles.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_rows.h"
#include "engine/methods/event_driven/contacts/group_bodies.h"

namespace constraint_sim::engine {

/// Joint of a contact group.
struct GroupJoint {
  int index;         ///< index in the world
  std::size_t a, b;  ///< indices in GroupBodies
  Joint joint;
  bool has_rows = true;  ///< rows of the kind; else coordinates only
  bool is_broken = false;
  bool was_saturated = false;             ///< value reported by the last step
  bool is_at_end = false;                 ///< a winch at the end of its travel, in this interval
  PrescribedMotion course{};              ///< prescribed motion in this interval
  RowVector impulse = RowVector::Zero();  ///< accumulated in the step, per row and coordinate
  RowVector impact = RowVector::Zero();   ///< part of `impulse` by impacts at one moment
};

/// Coordinate of a joint of a contact group, or length of a distance joint, on which a law acts.
struct GroupCoordinate {
  std::size_t joint;           ///< index in GroupJoints
  OneSidedLaw law;             ///< form, one-sided law and soft law of the coordinate
  bool is_prescribed = false;  ///< held by a motor without force limit
  bool is_one_sided = false;
  OneSidedState state;
  Motor motor{};   ///< demand in this interval; of laws with a drive
  int angle = -1;  ///< index in the angles; -1: no angle
  /// Position where friction or a drive began to hold the coordinate [m or rad].
  double held = 0.0;
  double held_at = 0.0;  ///< time when the hold began, simulated [s]
  /// Displacement of a yielding limit of a length since the step began [m].
  double given_way = 0.0;
  double reference = 0.0;  ///< admissible force, as reference of λ [N or N m]
  double braking = 0.0;    ///< deceleration, see CoordinateState
  double until = 0.0;      ///< end of braking by the motor, simulated [s]
};

/// Keeps the joints of a contact group, and answers how their coordinates move at the pose of the
/// bodies.
class GroupJoints {
 public:
  /// Position, rate and acceleration of a coordinate; `J`: its gradient.
  struct Reading {
    double q = 0.0, rate = 0.0, acceleration = 0.0;
    Jacobian J;
  };

  /// Joints and coordinates of the group; set before begin_interval().
  List<GroupJoint>& list() { return list_; }
  const List<GroupJoint>& list() const { return list_; }
  const GroupJoint& operator[](std::size_t joint) const { return list_[joint]; }
  List<GroupCoordinate>& coordinates() { return coordinates_; }
  const List<GroupCoordinate>& coordinates() const { return coordinates_; }
  /// Adds the coordinates of a joint on which a law acts.
  void add_coordinates(std::size_t joint);
  /// All angles of joints, numbered by joints and bodies.
  const TurnedAngles& angles() const { return angles_; }

  /// Starts prescribed motions at the time of the bodies, and takes over the demands of motors.
  /// `is_first`: also angles and braking decelerations.
  void begin_interval(const GroupBodies& bodies, const JointStep& step,
                      const List<JointState>& states, bool is_first);
  /// Integrates the angles to the time of the bodies, or takes their rates where velocities have
  /// jumped.
  void integrate_angles(const GroupBodies& bodies);
  /// Moves yielding limits of lengths along with the lengths.
  void move_yielding_limits(const GroupBodies& bodies);
  /// Removes all rows and laws of a joint.
  void break_joint(std::size_t joint);
  /// Whether any force or constraint depends on the time.
  bool is_moved_by_motors() const;

  // ---- coordinates
  /// Reads a coordinate, with the given accelerations of bodies or with zero accelerations.
  Reading read(const GroupBodies& bodies, const GroupCoordinate& coordinate,
               const GroupMotions* rates) const;
  /// Returns position, rate and acceleration of the upper or lower limit of a coordinate. A motor
  /// moves the limit of a length.
  Prescribed limit(const GroupBodies& bodies, const GroupCoordinate& coordinate,
                   bool upper_one) const;
  /// Returns the rate and acceleration that the motor of a coordinate demands.
  Prescribed zeta(const GroupBodies& bodies, const GroupCoordinate& coordinate) const;
  /// Returns the rest position of a servo.
  Prescribed rest(const GroupBodies& bodies, const GroupCoordinate& coordinate) const;
  /// Returns the force of springs and dampers, and of laws at their bounds.
  double free_force(const GroupBodies& bodies, const GroupCoordinate& coordinate,
                    const Reading& now) const;

  // ---- rows
  /// Adds the rows of joints that hold both ways without force limit.
  void add_rows(const GroupBodies& bodies, ContactRows* rows) const;
  /// Adds the rows that hold coordinates one way or up to a force.
  void add_held_rows(const GroupBodies& bodies, ContactRows* rows) const;

 private:
  void list_angles(const List<JointState>& states);
  Prescribed target(const GroupBodies& bodies, const GroupCoordinate& coordinate) const;
  void add_coordinate_row(const GroupBodies& bodies, std::size_t coordinate,
                          ContactRows* rows) const;

  List<GroupJoint> list_;
  List<GroupCoordinate> coordinates_;
  TurnedAngles angles_;
  List<OneSidedLaw> laws_;  // laws of the joint being added; scratch
};

}  // namespace constraint_sim::engine
