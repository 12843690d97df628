#pragma once

#include <array>
#include <cstddef>

#include "engine/constraints/joint.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/constraints/prescribed.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_joints.h"

namespace constraint_sim::engine {

struct EventBodies;
struct EventDecision;
struct EventReading;
class EventProblem;

/// How the laws of an event-driven island act: their states, and the prescribed motions of what
/// they hold. Laws are numbered as in EventJoints::laws(), joints as in EventJoints.
class EventMotions {
 public:
  explicit EventMotions(EventJoints joints);

  /// Takes over the laws of the joints. Returns false where these are other laws, by kind or by
  /// coordinate.
  bool follow_laws(const List<Joint>& all_joints) {
    if (!joints_.follow_laws(all_joints)) return false;
    const List<OneSidedState> none(laws().size());
    for (std::size_t l = 0; l < joints_.size(); ++l) joints_.with_rows(l, none, &bare_joints_[l]);
    return true;
  }
  const EventJoints& joints() const { return joints_; }
  const List<OneSidedLaw>& laws() const { return joints_.laws(); }
  /// Whether the states continue from the last interval.
  bool has_started() const { return has_started_; }
  void set_started(bool has_started) { has_started_ = has_started; }

  // ---- start of a step or an interval
  /// Takes over the joint states of the world.
  void begin_step(const List<JointData>& world);
  /// Mends all joints where the states do not continue, since a rejected step has broken no joint.
  /// Returns whether any was broken.
  bool mend_rejected();
  /// Takes over the joint states of the world, except positions, and starts the prescribed
  /// motions of an interval from t to `end`, part of `step` [s]. Returns whether all continue.
  bool begin_interval(const List<JointData>& world, const JointStep& step, double t, double end);

  // ---- states
  const List<OneSidedState>& states() const { return states_; }
  bool is_broken(std::size_t joint) const { return is_broken_[joint] != 0; }
  const List<char>& broken() const { return is_broken_; }
  void break_joint(std::size_t joint) { is_broken_[joint] = 1; }
  const List<JointData>& joint_states() const { return joint_states_; }
  double position(std::size_t joint, int coordinate) const {
    return joint_states_[joint].coordinates[to_index(coordinate)].position;
  }
  /// Deceleration of a motor that has lost its prescribed motion; 0: it follows the motion.
  double braking(std::size_t law) const { return braking_[law].most; }
  /// Held position q, travel of a held length, or end of braking [s].
  double held(std::size_t law) const { return held_[law]; }
  /// Prescribed motions of the rows that act, and of joints without one-sided rows.
  const List<PrescribedMotion>& prescribed() const { return prescribed_; }
  const List<PrescribedMotion>& bare_prescribed() const { return bare_prescribed_; }

  // ---- demands at time t
  /// Frame on B of a joint.
  MovingFrame frame(std::size_t joint, double t) const;
  /// Position and motion of a limit. A motor moves the limit of a length; an initial violation is
  /// closed in time.
  Prescribed limit(std::size_t law, bool upper_one, double t) const;
  /// Rate and acceleration that a motor with a force limit demands at q. For a motor with a goal,
  /// `value` is the position of its prescribed motion.
  Prescribed zeta(std::size_t law, double t, double q) const;
  /// Rest position of a servo.
  Prescribed rest(std::size_t law, double t) const;
  /// Whether the motor or servo of a law in `state` is saturated, or its winch is at the end of the
  /// travel.
  bool is_saturated(std::size_t law, const OneSidedState& state, double t, double q) const;

  // ---- changes
  /// Takes over the coordinates at time t, with whole turns as `equations` have counted them.
  void note_positions(const EventBodies& bodies, double t, const EquationsOfMotion& equations);
  /// Finds the motors that do not follow their prescribed motions, before states are decided. A
  /// motor that has just lost its motion brakes with the deceleration by half of its force, while
  /// other motors hold.
  void find_lost(const EventProblem& problem, double t);
  /// Finds the motors that lose their prescribed motions in the decided states. Returns whether
  /// there are any: they take another direction, so that the states are to be decided again.
  bool note_lost(const EventProblem& problem, const EventDecision& next);
  /// Takes over the states from time t on: sets where rows hold their coordinates, and restarts the
  /// prescribed motions of changed joints.
  void change_states(const EventProblem& problem, const List<OneSidedState>& next, double t);
  /// Sets the held values of all laws for the next interval, and the saturation of joints, at the
  /// time `t` that an interval got to [s]; `equations` and `rates` as in read_law().
  void finish(const EventBodies& bodies, const EquationsOfMotion& equations, const Motions& rates,
              double t);
  /// Writes where motors with a force limit hold, whether they are saturated, and whether the joint
  /// broke. `positions`: all coordinates of the joint, laid out as JointStep::counted.
  void write(std::size_t joint, JointData* state,
             std::array<double, kMaxCoordinates>* positions) const;

  /// Visits which joints are broken, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_broken(Self& self, Visit& visit) {
    visit.beside(self.is_broken_);
  }
  /// Visits the states of laws and their prescribed motions.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.has_started_);
    visit.beside(self.prescribed_);
    visit.beside(self.bare_prescribed_);
    if (!self.has_started_) return;
    for (std::size_t c = 0; c < self.laws().size(); ++c) {
      auto& state = self.states_[c];
      visit(state.hold);
      for (auto* sign : {&state.slip, &state.drive, &state.yield}) visit(*sign);
      if (self.laws()[c].has_servo()) visit(state.servo);
      visit(self.held_[c]);
      if (state.hold == Hold::kBrake) visit(self.braking_[c].along);
    }
    if constexpr (Visit::kReads)
      for (std::size_t l = 0; l < self.joints_.size(); ++l) self.set_rows(l);
  }

 private:
  /// Deceleration of a motor that has lost its prescribed motion, and its value while the motor
  /// comes to rest, < 0 from below [m/s² or rad/s²].
  struct Braking {
    double most = 0.0, along = 0.0;
  };

  Prescribed motion_to_goal(std::size_t law, double t) const;
  double travel(std::size_t joint, double t) const;
  double braking_of(const EventProblem& problem, std::size_t law) const;
  void set_rows(std::size_t joint);
  void begin_prescribed(std::size_t joint, double t);
  void hold_length(std::size_t law, double q, const OneSidedState& next, double t);
  void hold_motors(std::size_t joint, double t);

  EventJoints joints_;
  bool has_started_ = false;
  List<OneSidedState> states_;
  List<double> held_;
  List<Braking> braking_;
  List<char> is_broken_;            // per joint
  List<JointData> joint_states_;    // positions of coordinates, and offsets being closed
  JointStep step_{};                // step that contains the interval
  double start_ = 0.0, end_ = 0.0;  // interval [s]
  List<Joint> switched_joints_;     // joints with rows as in states_, for prescribed motions
  List<Joint> bare_joints_;         // without one-sided rows
  List<PrescribedMotion> prescribed_, bare_prescribed_;
  List<double> base_;     // per distance joint: prescribed length without travel [m]
  List<char> is_at_end_;  // per joint: a winch at the end of its travel
};

}  // namespace constraint_sim::engine
