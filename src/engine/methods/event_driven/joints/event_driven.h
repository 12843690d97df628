#pragma once

#include <Eigen/Core>
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

/// An island with one-sided rows, carried from event to event: between two events every such row is
/// either a rigid row, a constant force or nothing, so that the island is an ordinary one, which
/// RungeKutta carries. Substeps watch what each row depends on (gaps, rates, forces); where one
/// passes zero the substep is taken again from its start, at full order, so that it ends there. At
/// an event limits that are hit have impacts, and a complementarity problem of the accelerations
/// says what each row does from there on.
class EventDriven {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  EventDriven(const EventDriven& other);
  EventDriven(EventDriven&& other) noexcept;
  EventDriven& operator=(const EventDriven& other);
  EventDriven& operator=(EventDriven&& other) noexcept;
  ~EventDriven();

  using Ends = List<std::pair<std::size_t, std::size_t>>;

  /// Beyond so many rows an island is left to others.
  static constexpr std::size_t kMostRows = 32;

  /// Of the joints of an island, `members` by index. `couplings`, `open` as EquationsOfMotion.
  EventDriven(const List<int>& members, const List<Joint>& all_joints, const Ends& ends,
              const List<CoupledTerms>& couplings, const List<MassProperties>& masses,
              const List<char>& open);

  /// The equations without any one-sided row, to begin with.
  const EquationsOfMotion& bare() const { return bare_; }

  /// What surrounds an island in a span.
  struct Surroundings {
    JointStep step;  ///< of the span
    const List<JointState>& joint_states;
    const List<JointState>& told;  ///< these, as the last step left them
    const List<MassProperties>& masses;
  };

  /// Clears impulses and counts of the step before.
  void begin_step(const List<JointState>& joint_states, RungeKutta* motion);
  /// As method.h says; `motion` has the equations of the rows that act now.
  IntegrationResult advance(const SmoothSpan& span, const IntegratorOptions& accuracy,
                            const Surroundings& around, RungeKutta* motion,
                            List<BodyState>* states);
  /// What rows do is decided anew: somebody else has moved the bodies.
  void forget() { has_started_ = false; }

  // ---- what was done since begin_step(), once the step is over
  std::uint32_t events() const { return events_; }
  /// One event of those.
  struct Told {
    EventKind kind;
    double time;        ///< simulated [s]
    std::size_t joint;  ///< among joints()
    int coordinate;     ///< -1 of a distance joint, and of a joint that broke
    double impulse;     ///< of an impact ≥ 0
  };
  const List<Told>& told() const { return told_; }
  /// Adds what the rows that act now have done.
  void collect(const List<BodyState>& states, RungeKutta* motion);
  const List<int>& joints() const { return members_; }
  /// As EquationsOfMotion::impulse(), of joints()[l].
  const RowVector& impulse(std::size_t l) const { return impulses_[l]; }
  double coupled_impulse(std::size_t l) const { return coupled_impulses_[l]; }
  /// Sets where motors with a force limit hold, whether these have reached it, and what broke.
  void write(std::size_t l, JointState* state) const;

  /// Visits which rows act, which `motion` then has, as engine/memory.h says.
  template <class Self, class Visit, class Motion>
  static void visit_rows(Self& self, Visit& visit, const List<MassProperties>& masses,
                         Motion& motion) {
    visit.beside(self.is_broken_);
    visit.beside(self.compiled_for_);
    visit.beside(self.broken_then_);
    if constexpr (Visit::kReads) self.compile_again(masses, &motion);
  }
  /// Visits all that the next advance() goes on from, beside the bodies and what RungeKutta has.
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
      if (self.laws_[c].servo_most > 0.0) visit(state.servo);
      visit(self.held_[c]);
    }
    if constexpr (Visit::kReads)
      for (std::size_t l = 0; l < self.joints_.size(); ++l) self.set_rows(l);
  }
  /// Lets equations that were just compiled go on from `t`, where a span begins.
  void continue_from(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
                     const List<AppliedWrench>& loads, RungeKutta* motion) const {
    motion->equations().continue_from(t, states, gravity, loads, courses_);
  }

 private:
  /// A coordinate now; `J` of its gradient.
  struct Reading {
    double q = 0.0, rate = 0.0, acceleration = 0.0;
    Jacobian J;
  };
  struct Watched : WatchedValue {
    int law = -1;          ///< whose it is
    int breaks = -1;       ///< the joint that breaks then
    signed char side = 0;  ///< of a force: -1 of its lower bound, +1 of its upper one
  };
  /// The rows that act, with their equations.
  struct Variant {
    List<OneSidedState> states;
    List<char> is_broken;
    RungeKutta motion;
  };
  /// A joint that breaks.
  struct Breaking {
    std::size_t joint;
    double force, torque;
  };
  /// A held coordinate whose force is at a bound, and gives way.
  struct Release {
    int law = -1;
    signed char side = 0;  ///< of the bound
  };
  /// A limit that takes part in an impact: +1 of a lower one, −1 of an upper one.
  struct Hit {
    std::size_t law;
    double direction;
    double rate;  ///< of the gap
    double restitution;
  };
  /// A coordinate that moves as something that holds it.
  struct Candidate {
    std::size_t law;
    Hold hold;
    double rate, acceleration;
    double zeta;  ///< the rate that its motor asks for
    ForceBounds bounds;
  };
  struct Span;  // what advance() goes through
  struct Rows;  // a problem at an event

  // ---- compiled
  EquationsOfMotion compile(const List<OneSidedState>& states,
                            const List<MassProperties>& masses) const;
  void compile_again(const List<MassProperties>& masses, RungeKutta* motion);
  bool switched(std::size_t joint, const List<OneSidedState>& states, Joint* result) const;
  std::pair<std::size_t, std::size_t> laws_of(std::size_t joint) const;

  // ---- where things are
  BodyState body(const Span& span, int body, double t) const;
  Reading read(const Span& span, const OneSidedLaw& law, double t,
               const EquationsOfMotion& equations, const EquationsOfMotion::Motions& rates) const;
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

  // ---- between events (what waits for events: event_location.cpp)
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
  SmoothSpan rest_of(const Span& span) const;

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
  List<Joint> joints_;  // the same
  Ends ends_;           // of these
  List<char> open_;     // which of these EquationsOfMotion takes for open; none where empty
  List<CoupledTerms> couplings_;
  List<OneSidedLaw> laws_;       // of one joint after the other
  List<std::size_t> first_law_;  // of joints, and the end
  List<Joint> bare_joints_;      // without one-sided rows
  List<Breaking> breaking_;
  EquationsOfMotion bare_;
  List<OneSidedState> compiled_for_;  // what RungeKutta has
  List<char> broken_then_;            // the same
  List<Variant> others_;              // those compiled before, for the next time

  bool has_started_ = false;
  List<OneSidedState> states_;   // of laws
  List<Joint> switched_joints_;  // as these say, for courses
  List<double> held_;     // what friction and motors hold: q, the travel of a length, or until
                          // when a motor brakes [s]
  List<double> braking_;  // of motors, as CoordinateState has it

  // ---- of this step
  List<char> is_broken_;           // joints
  List<JointState> joint_states_;  // where coordinates are, and what is being closed
  List<PrescribedMotion> courses_, bare_courses_;
  List<double> base_;     // of a distance joint's course, without travel
  List<char> is_at_end_;  // of joints: a winch, of its travel
  List<RowVector> impulses_;
  List<double> coupled_impulses_;
  std::uint32_t events_ = 0;
  mutable List<char> pressed_;  // laws whose motor is too weak to take them off a limit
  List<Told> told_;
  int unchanged_ = 0;  // events that changed nothing
  WatchedSubstep<Watched> watched_;
  EquationsOfMotion::Motions rates_;
  std::optional<LeastNormForces> least_forces_;  // of the rows that act now
};

}  // namespace constraint_sim::engine
