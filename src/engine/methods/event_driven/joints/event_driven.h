#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/event.h"
#include "engine/constraints/joint.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/method.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/event_stepper.h"
#include "engine/methods/event_driven/joints/event_decision.h"
#include "engine/methods/event_driven/joints/event_impulses.h"
#include "engine/methods/event_driven/joints/event_joints.h"
#include "engine/methods/event_driven/joints/event_motions.h"
#include "engine/methods/event_driven/joints/event_problem.h"
#include "engine/methods/event_driven/joints/event_variants.h"
#include "engine/methods/event_driven/joints/event_watching.h"
#include "engine/methods/event_driven/rattling.h"
#include "engine/methods/runge_kutta/runge_kutta.h"

namespace constraint_sim::engine {

/// Advances an island with one-sided rows from event to event. Between events every one-sided row
/// is a rigid row, a constant force or absent, so RungeKutta advances an ordinary island. Substeps
/// watch gaps, rates and forces; where a watched value passes zero, the substep is repeated at full
/// order to end there. At an event, limits that are hit have impacts, and a complementarity problem
/// of accelerations decides how each row acts next.
///
/// EventJoints has the joints and their laws, EventMotions how each law acts and which motion it
/// prescribes, EventVariants the equations of the rows that act. Between events watch_joints()
/// lists the watched values. At an event EventProblem collects readings and responses,
/// event_impacts.h and event_decision.h solve it.
class EventDriven {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  EventDriven(const EventDriven& other);
  EventDriven(EventDriven&& other) noexcept;
  EventDriven& operator=(const EventDriven& other);
  EventDriven& operator=(EventDriven&& other) noexcept;
  ~EventDriven();

  using Ends = EventJoints::Ends;

  /// Largest number of coordinates with friction or a motor with a force limit; islands with more
  /// use another method, since the dense problem of an event takes the cube of their number. Limits
  /// do not count, since few are reached at a time.
  static constexpr std::size_t kMostRows = 128;

  /// `members`: indices of the joints of the island. `couplings`, `open`: as in EquationsOfMotion.
  EventDriven(const List<int>& members, const List<Joint>& all_joints, const Ends& ends,
              const List<CoupledTerms>& couplings, const List<MassProperties>& masses,
              const List<char>& open);

  /// Takes over the laws of the joints, `motion` included. Returns false where the island has to be
  /// compiled anew. Where other than forces along coordinates change, both have to begin anew.
  bool follow_laws(const List<Joint>& all_joints, RungeKutta* motion);

  /// Equations without any one-sided row, from which an island starts.
  const EquationsOfMotion& bare() const { return variants_.bare(); }

  /// Inputs of an interval from outside the island.
  struct Surroundings {
    JointStep step;  ///< step that contains the interval
    const List<JointData>& joint_states;
    const List<JointData>& reported;  ///< joint states as reported by the last step
    const List<MassProperties>& masses;
  };

  /// Clears impulses and counts of the previous step.
  void begin_step(const List<JointData>& joint_states, RungeKutta* motion);
  /// Advances the island as IslandMethod describes; `motion` has the equations of the rows that act
  /// now.
  IntegrationResult advance(const Interval& interval, const IntegratorOptions& options,
                            const Surroundings& around, RungeKutta* motion,
                            List<BodyState>* states);
  /// Whether the next interval continues with the states of rows.
  bool has_started() const { return motions_.has_started(); }
  /// Forgets the states of rows, after bodies were moved from outside.
  void forget() { motions_.set_started(false); }
  void restart() { forget(); }
  /// Gives `motion` the equations with which an island that was just compiled begins.
  void restart(RungeKutta* motion) {
    restart();
    variants_.begin_anew(motions_.joints(), motions_.broken(), motion);
  }

  // ---- results since begin_step(), complete at the end of the step
  std::uint32_t events() const { return stepper_.events(); }
  /// Reported event.
  struct Reported {
    EventKind kind;
    double time;        ///< simulated [s]
    std::size_t joint;  ///< index in joints()
    int coordinate;     ///< -1: a distance joint, a coupling, or a joint that broke
    double impulse;     ///< impulse of an impact, ≥ 0 [N s or N m s]
  };
  const List<Reported>& reported() const { return reported_; }
  /// Adds the impulses of the rows that act now.
  void collect(const List<BodyState>& states, RungeKutta* motion);
  const List<int>& joints() const { return motions_.joints().members(); }
  /// Impulse of joints()[l], laid out as JointForces::impulse().
  const RowVector& impulse(std::size_t l) const { return impulses_.sums().joint[l]; }
  double coupled_impulse(std::size_t l) const { return impulses_.sums().coupled[l]; }
  /// Writes where motors with a force limit hold, whether they are saturated, and whether the joint
  /// broke. `positions`: all coordinates of joints()[l], laid out as JointStep::counted.
  void write(std::size_t l, JointData* state,
             std::array<double, kMaxCoordinates>* positions) const {
    motions_.write(l, state, positions);
  }

  /// Visits the states of rows, as engine/support/memory.h describes. Reading compiles bare() and
  /// `motion` for these states.
  template <class Self, class Visit, class Motion>
  static void visit_rows(Self& self, Visit& visit, const List<MassProperties>& masses,
                         Motion& motion) {
    EventMotions::visit_broken(self.motions_, visit);
    EventVariants::visit_memory(self.variants_, visit);
    if constexpr (Visit::kReads)
      self.variants_.compile_again(self.motions_.joints(), self.motions_.broken(), masses, &motion);
  }
  /// Visits all state that the next advance() continues from, except the bodies and the memory of
  /// RungeKutta.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    EventMotions::visit_memory(self.motions_, visit);
  }
  /// Continues an interval that starts at `t` with equations that were just compiled.
  void continue_from(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
                     const List<AppliedWrench>& loads, RungeKutta* motion) const {
    motion->equations().continue_from(t, states, gravity, loads, motions_.prescribed());
  }

 private:
  /// State of advance().
  struct Run {
    const Interval& interval;
    const IntegratorOptions& options;
    const Surroundings& around;
    RungeKutta* motion;
    List<BodyState>* states;  ///< all bodies of the world; bodies of the island are at `left.t`
    RemainingInterval left;
    IntegrationResult progress;
    bool begins = true;  ///< true until bodies move in the interval

    double t() const { return left.t; }
    EventBodies bodies() const {
      return {*states, around.masses, interval.t - interval.since_tick};
    }
  };

  // ---- between events
  bool begin_run(Run* run);
  bool advance_to_event(Run* run);
  void watch(const Run& run, double h, List<WatchedByJoints>* list);
  Interval remaining(const Run& run) const;

  // ---- at events
  void end_rattling(Run* run, const WatchedByJoints& watched);
  bool change_states(Run* run, const WatchedByJoints& watched, bool* is_changed);
  void break_joint(Run* run, std::size_t joint);
  bool settle(Run* run, const EventRelease& release, bool is_changed, bool* had_impacts);
  List<std::size_t> broken_by_impacts(const Run& run, const EventImpulses::Sums& before) const;
  void add_overloaded(List<std::size_t>* broken) const;
  bool load(Run* run, EventProblem* problem);
  bool have_impacts(Run* run, EventProblem* problem, bool* any);
  bool let_rest(const Run& run, const List<char>& bounced, EventProblem* problem, List<char>* rests,
                bool* is_settled);
  std::optional<EventDecision> decide_states(const Run& run, const EventProblem& problem,
                                             const EventRelease& release);
  bool was_saturated(const Run& run, std::size_t law, const EventReading& now) const;
  void report(const Run& run, const EventProblem& problem, const List<OneSidedState>& next);
  bool switch_to_states(Run* run);

  EventMotions motions_;
  EventVariants variants_;
  // ---- values of the current step
  EventImpulses impulses_;
  EventStepper<WatchedByJoints> stepper_;
  Rattling rattling_;
  double resting_ = kResting;  // rate that counts as zero [m/s or rad/s]
  List<Reported> reported_;
  Motions rates_;  // accelerations of the bodies when values were last watched
};
static_assert(IslandMethod<EventDriven, const EventDriven::Surroundings&, RungeKutta*>::kIsHeld);

}  // namespace constraint_sim::engine
