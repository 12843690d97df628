#pragma once

#include <cstddef>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/joint.h"
#include "engine/dynamics/turned_angles.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_rows.h"
#include "engine/methods/event_driven/contacts/group_bodies.h"
#include "engine/methods/event_driven/contacts/group_joint.h"
#include "engine/methods/event_driven/law_events.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

/// Keeps the joints of a contact group, and answers how their coordinates move at the pose of the
/// bodies.
class GroupJoints {
 public:
  /// Position, rate and acceleration of a coordinate or coupling; `J`: its gradient.
  struct Reading {
    double q = 0.0, rate = 0.0, acceleration = 0.0;
    Jacobian J, J_second;  ///< `J_second`: of the second term of a coupling

    void add(double weight, const Reading& other);
  };

  /// Joints and coordinates of the group; set before begin_interval().
  List<GroupJoint>& list() { return list_; }
  const List<GroupJoint>& list() const { return list_; }
  const GroupJoint& operator[](std::size_t joint) const { return list_[joint]; }
  List<GroupCoordinate>& coordinates() { return coordinates_; }
  const List<GroupCoordinate>& coordinates() const { return coordinates_; }
  /// Sets the joints of a coupling, by their indices in the world. False where one is missing.
  bool set_terms(std::size_t joint, const CoupledTerms& terms);
  /// Adds those coordinates of a joint that have a law.
  void add_coordinates(std::size_t joint) {
    engine::add_coordinates(joint, &list_[joint], &laws_, &coordinates_);
  }
  /// All angles of joints, numbered by joints and bodies.
  const TurnedAngles& angles() const { return angles_; }

  /// Starts prescribed motions at the time of the bodies, and takes over the demands of motors.
  /// `is_first`: also angles and braking decelerations.
  void begin_interval(const GroupBodies& bodies, const JointStep& step,
                      const List<JointData>& states, bool is_first);
  /// Integrates the angles to the time of the bodies, or takes their rates where velocities have
  /// jumped.
  void integrate_angles(const GroupBodies& bodies);
  /// Moves yielding limits of lengths along with the lengths.
  void move_yielding_limits(const GroupBodies& bodies);
  /// Removes all rows and laws of a joint.
  void break_joint(std::size_t joint);
  /// Reads prescribed motions that are about to start as in `interval` [s]; or as they are.
  void look_ahead(double interval) {
    if (!list_.empty()) ahead_ = {interval, closing_time_};
  }
  void look_now() { ahead_ = {}; }
  /// Whether any force or constraint depends on the time.
  bool depends_on_time() const;
  /// Whether forces and constraints depend on nothing but settings and the numbers that
  /// add_numbers() adds, beside the bodies. Functions of other packages may depend on more.
  bool are_at_rest() const;
  /// Adds the numbers with which an interval begins.
  void add_numbers(const GroupBodies& bodies, List<double>* numbers) const;
  /// Whether forces act beside those of rows.
  bool has_free_forces() const { return !coordinates_.empty() || has_custom_forces_; }

  // ---- coordinates
  /// Reads a coordinate, with the given accelerations of bodies or with zero accelerations.
  Reading read(const GroupBodies& bodies, const GroupCoordinate& coordinate,
               const GroupMotions* rates) const;
  /// Returns position, rate and acceleration of the upper or lower limit of a coordinate. A motor
  /// moves the limit of a length.
  Prescribed limit(const GroupBodies& bodies, const GroupCoordinate& coordinate,
                   bool upper_one) const;
  /// Returns the rate and acceleration that the motor of a coordinate demands. `back`: time before
  /// that of the bodies, for a motor with a rate [s].
  Prescribed zeta(const GroupBodies& bodies, const GroupCoordinate& coordinate,
                  double back = 0.0) const;
  /// Returns the rest position of a servo.
  Prescribed rest(const GroupBodies& bodies, const GroupCoordinate& coordinate) const;
  /// Returns the force of springs and dampers, and of laws at their bounds.
  double free_force(const GroupBodies& bodies, const GroupCoordinate& coordinate,
                    const Reading& now) const;

  // ---- motors with a position
  /// Prescribed motion of a motor with a force limit to its position.
  Prescribed motion_to_goal(const GroupBodies& bodies, const GroupCoordinate& coordinate) const;
  /// Ends the prescribed motion of a coordinate to its position.
  void end_motion_to_goal(const GroupCoordinate& coordinate);

  // ---- rows
  /// Adds a row with the gradient of a coordinate or coupling.
  ContactRow& add_row(const GroupBodies& bodies, const GroupCoordinate& coordinate,
                      const Reading& now, ContactRows* rows) const;
  /// Adds the rows of joints that hold both ways without force limit.
  void add_rows(const GroupBodies& bodies, ContactRows* rows) const;
  /// Adds the rows that hold coordinates one way or up to a force.
  void add_held_rows(const GroupBodies& bodies, ContactRows* rows) const;

 private:
  void list_angles(const List<JointData>& states);
  Reading read_form(const GroupBodies& bodies, std::size_t joint, const ScalarForm& form,
                    double zero, int angle, const GroupMotions* rates) const;
  Reading read_coupling(const GroupBodies& bodies, std::size_t joint,
                        const GroupMotions* rates) const;
  void add_coupling_row(const GroupBodies& bodies, std::size_t joint, ContactRows* rows) const;
  template <class Motion>
  Prescribed read_prescribed(const GroupBodies& bodies, const Motion& motion) const {
    return about_to_start(motion, bodies.clock(), ahead_);
  }
  Prescribed target(const GroupBodies& bodies, const GroupCoordinate& coordinate) const;
  void add_coordinate_row(const GroupBodies& bodies, std::size_t coordinate,
                          ContactRows* rows) const;

  List<GroupJoint> list_;
  List<GroupCoordinate> coordinates_;
  TurnedAngles angles_;
  bool has_custom_forces_ = false;
  double closing_time_ = 0.0;  // [s]
  StartAhead ahead_;
  List<OneSidedLaw> laws_;  // laws of the joint being added; scratch
};

}  // namespace constraint_sim::engine
