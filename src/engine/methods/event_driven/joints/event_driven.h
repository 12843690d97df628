#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/event.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/least_norm_forces.h"
#include "engine/dynamics/method.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_watch.h"
#include "engine/methods/runge_kutta/runge_kutta.h"

namespace constraint_sim::engine {

/// Advances an island with one-sided rows from event to event. Between events every one-sided row
/// is a rigid row, a constant force or absent, so RungeKutta advances an ordinary island. Substeps
/// watch gaps, rates and forces; where a watched value passes zero, the substep is repeated at full
/// order to end there. At an event, limits that are hit have impacts, and a complementarity problem
/// of accelerations decides how each row acts next.
class EventDriven {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  EventDriven(const EventDriven& other);
  EventDriven(EventDriven&& other) noexcept;
  EventDriven& operator=(const EventDriven& other);
  EventDriven& operator=(EventDriven&& other) noexcept;
  ~EventDriven();

  using Ends = List<std::pair<std::size_t, std::size_t>>;

  /// Largest number of one-sided rows; islands with more rows use another method.
  static constexpr std::size_t kMostRows = 32;

  /// `members`: indices of the joints of the island. `couplings`, `open`: as in EquationsOfMotion.
  EventDriven(const List<int>& members, const List<Joint>& all_joints, const Ends& ends,
              const List<CoupledTerms>& couplings, const List<MassProperties>& masses,
              const List<char>& open);

  /// Equations without any one-sided row, from which an island starts.
  const EquationsOfMotion& bare() const { return bare_; }

  /// Inputs of an interval from outside the island.
  struct Surroundings {
    JointStep step;  ///< step that contains the interval
    const List<JointState>& joint_states;
    const List<JointState>& told;  ///< joint states as reported by the last step
    const List<MassProperties>& masses;
  };

  /// Clears impulses and counts of the previous step.
  void begin_step(const List<JointState>& joint_states, RungeKutta* motion);
  /// Advances the island as method.h describes; `motion` has the equations of the rows that act
  /// now.
  IntegrationResult advance(const Interval& span, const IntegratorOptions& accuracy,
                            const Surroundings& around, RungeKutta* motion,
                            List<BodyState>* states);
  /// Forgets the states of rows, after bodies were moved from outside.
  void forget() { has_started_ = false; }

  // ---- results since begin_step(), complete at the end of the step
  std::uint32_t events() const { return events_; }
  /// Reported event.
  struct Told {
    EventKind kind;
    double time;        ///< simulated [s]
    std::size_t joint;  ///< index in joints()
    int coordinate;     ///< -1: a distance joint, a coupling, or a joint that broke
    double impulse;     ///< impulse of an impact, ≥ 0 [N s or N m s]
  };
  const List<Told>& told() const { return told_; }
  /// Adds the impulses of the rows that act now.
  void collect(const List<BodyState>& states, RungeKutta* motion);
  const List<int>& joints() const { return members_; }
  /// Impulse of joints()[l], laid out as JointForces::impulse().
  const RowVector& impulse(std::size_t l) const { return impulses_[l]; }
  double coupled_impulse(std::size_t l) const { return coupled_impulses_[l]; }
  /// Writes where motors with a force limit hold, whether they are saturated, and whether the joint
  /// broke. `positions`: all coordinates of joints()[l], laid out as JointStep::counted.
  void write(std::size_t l, JointState* state,
             std::array<double, kMaxCoordinates>* positions) const;

  /// Visits the states of rows, as engine/support/memory.h describes. Reading compiles bare() and
  /// `motion` for these states.
  template <class Self, class Visit, class Motion>
  static void visit_rows(Self& self, Visit& visit, const List<MassProperties>& masses,
                         Motion& motion) {
    visit.beside(self.is_broken_);
    visit.beside(self.compiled_for_);
    visit.beside(self.broken_then_);
    if constexpr (Visit::kReads) self.compile_again(masses, &motion);
  }
  /// Visits all state that the next advance() continues from, except the bodies and the memory of
  /// RungeKutta.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.has_started_);
    visit.beside(self.courses_);
    visit.beside(self.bare_courses_);
    if (!self.has_started_) return;
    for (std::size_t c = 0; c < self.laws_.size(); ++c) {
      auto& state = self.states_[c];
      visit(state.hold);
      for (auto* sign : {&state.slip, &state.drive, &state.yield}) visit(*sign);
      if (self.laws_[c].has_servo()) visit(state.servo);
      visit(self.held_[c]);
    }
    if constexpr (Visit::kReads)
      for (std::size_t l = 0; l < self.joints_.size(); ++l) self.set_rows(l);
  }
  /// Continues an interval that starts at `t` with equations that were just compiled.
  void continue_from(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
                     const List<AppliedWrench>& loads, RungeKutta* motion) const {
    motion->equations().continue_from(t, states, gravity, loads, courses_);
  }

 private:
  /// Coordinate or coupling at the current state.
  struct Reading {
    double q = 0.0, rate = 0.0, acceleration = 0.0;
    Jacobian J;         ///< gradient; of a coupling the gradient of its first term
    Jacobian J_second;  ///< gradient of the second term of a coupling
  };
  struct Watched : WatchedValue {
    int law = -1;          ///< law of the value; -1: none
    int breaks = -1;       ///< joint that breaks at the event; -1: none
    signed char side = 0;  ///< bound of a force: -1 lower, +1 upper
  };
  /// Compiled equations for one set of states.
  struct Variant {
    List<OneSidedState> states;
    List<char> is_broken;
    RungeKutta motion;
  };
  /// Joint with a breaking force or torque.
  struct Breaking {
    std::size_t joint;
    double force, torque;
  };
  /// Held coordinate that is released, since its force has reached a bound.
  struct Release {
    int law = -1;
    signed char side = 0;  ///< bound: -1 lower, +1 upper
  };
  /// Limit in an impact. `direction`: +1 for a lower limit, −1 for an upper limit.
  struct Hit {
    std::size_t law;
    double direction;
    double rate;  ///< rate of the gap
    double restitution;
  };
  /// Coordinate that moves at the rate of a law that may hold it.
  struct Candidate {
    std::size_t law;
    Hold hold;
    double rate, acceleration;
    double zeta;  ///< rate that the motor demands
    ForceBounds bounds;
  };
  struct Span;  // state of advance()
  struct Rows;  // problem at an event

  // ---- compilation
  EquationsOfMotion compile(const List<OneSidedState>& states,
                            const List<MassProperties>& masses) const;
  void compile_again(const List<MassProperties>& masses, RungeKutta* motion);
  bool switched(std::size_t joint, const List<OneSidedState>& states, Joint* result) const;
  std::pair<std::size_t, std::size_t> laws_of(std::size_t joint) const;

  // ---- kinematics
  BodyState body(const Span& span, int body, double t) const;
  Reading read(const Span& span, const OneSidedLaw& law, double t,
               const EquationsOfMotion& equations, const Motions& rates) const;
  void note_positions(const Span& span, double t);
  Prescribed limit(std::size_t law, bool upper_one, double t) const;
  Prescribed zeta(const Span& span, std::size_t law, double t, double q) const;
  bool is_saturated(const Span& span, std::size_t law, const OneSidedState& state, double t,
                    double q) const;
  bool was_saturated(const Span& span, std::size_t law, const Reading& now) const;
  void note_saturated(const Span& span);
  Prescribed rest(std::size_t law, double t) const;
  Prescribed course_of(std::size_t law, double t) const;
  double travel(std::size_t joint, double t) const;
  void set_rows(std::size_t joint);
  void begin_course(const Span& span, std::size_t joint, double t);
  bool begin_courses(const Span& span);

  // ---- between events (event_location.cpp)
  bool begin_span(Span* span);
  void hold_from(const Span& span, std::size_t law);
  bool advance_to_event(Span* span);
  void watch(const Span& span, double t, List<Watched>* list);
  void watch_force(const Span& span, std::size_t law, const Reading& reading, double t,
                   List<Watched>* list) const;
  void watch_breaking(const Span& span, double t, List<Watched>* list) const;
  bool locate(Span* span, const SubstepSpan& start, double h, std::optional<Crossing>* event);
  void break_joint(Span* span, std::size_t joint);
  bool finish_event(Span* span, std::size_t which);
  Interval rest_of(const Span& span) const;

  // ---- at events (event_states.cpp)
  bool settle(Span* span, const Release& release, bool is_changed, bool* had_impacts);
  bool load_rows(Span* span, Rows* rows);
  void read_rows(const Span& span, Rows* rows) const;
  void find_responses(Rows* rows);
  void apply_impulse(Rows* rows, std::size_t law, double impulse);
  List<Hit> find_hits(const Span& span, const Rows& rows, const List<char>& rests) const;
  bool have_impacts(Span* span, Rows* rows, bool* any);
  bool have_impact(const List<Hit>& hits, Rows* rows);
  bool go_on_after_impacts(Span* span, Rows* rows);
  bool let_rest(const Span& span, Rows* rows, const List<char>& bounced, List<char>* rests,
                bool* is_settled) const;
  std::optional<Candidate> candidate(const Span& span, std::size_t law, const Reading& reading,
                                     OneSidedState* state) const;
  OneSidedState leaving(const Candidate& from, signed char side) const;
  void find_lost(const Span& span, const Rows& rows);
  void note_lost(const Rows& rows, const List<OneSidedState>& next);
  double braking_of(const Rows& rows, std::size_t law) const;
  bool decide_once(const Span& span, Rows* rows, const Release& release,
                   List<OneSidedState>* next) const;
  bool decide_holds(const Span& span, Rows* rows, const Release& release,
                    List<OneSidedState>* next) const;
  bool decide(const Span& span, Rows* rows, const Release& release,
              List<OneSidedState>* next) const;
  void hold_rows(const Span& span, const Rows& rows, const List<OneSidedState>& next);
  void tell(const Span& span, const Rows& rows, const List<OneSidedState>& next);
  bool switch_to_states(Span* span);

  List<int> members_;
  List<Joint> joints_;  // order of members_
  Ends ends_;           // ends of joints_
  List<char> open_;     // per joint: compiled as open; empty where none is open
  List<CoupledTerms> couplings_;
  List<OneSidedLaw> laws_;       // grouped by joint
  List<std::size_t> first_law_;  // per joint, then the end
  List<Joint> bare_joints_;      // without one-sided rows
  List<Breaking> breaking_;
  EquationsOfMotion bare_;
  List<OneSidedState> compiled_for_;  // states that RungeKutta is compiled for
  List<char> broken_then_;            // joints that are broken in that compilation
  List<Variant> others_;              // earlier compilations, for reuse

  bool has_started_ = false;
  List<OneSidedState> states_;   // per law
  List<Joint> switched_joints_;  // joints with rows as in states_, for prescribed motions
  List<double> held_;  // Per law: held position q, travel of a held length, or end of braking [s].
  List<double> braking_;  // decelerations of motors, see CoordinateState

  // ---- values of the current step
  List<char> is_broken_;           // per joint
  List<JointState> joint_states_;  // positions of coordinates, and offsets being closed
  List<PrescribedMotion> courses_, bare_courses_;
  List<double> base_;     // per distance joint: prescribed length without travel [m]
  List<char> is_at_end_;  // per joint: a winch at the end of its travel
  List<RowVector> impulses_;
  List<double> coupled_impulses_;
  std::uint32_t events_ = 0;
  mutable List<char> pressed_;  // laws whose motor is too weak to leave a limit
  List<Told> told_;
  int unchanged_ = 0;  // events that changed nothing
  WatchedSubstep<Watched> watched_;
  Motions rates_;
  std::optional<LeastNormForces> least_forces_;  // reported forces of the rows that act now
};

}  // namespace constraint_sim::engine
