#pragma once

#include <cstdint>

#include "constraint_sim/engine/event.h"
#include "engine/constraints/joint.h"
#include "engine/dynamics/method.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_impacts.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"
#include "engine/methods/event_driven/contacts/contact_reports.h"
#include "engine/methods/event_driven/contacts/contact_states.h"
#include "engine/methods/event_driven/contacts/contact_watch.h"
#include "engine/methods/event_driven/contacts/counted_solver.h"
#include "engine/methods/event_driven/contacts/overlap_closing.h"
#include "engine/methods/event_driven/contacts/unchanged_interval.h"
#include "engine/methods/event_driven/event_stepper.h"
#include "engine/methods/event_driven/rattling.h"
#include "engine/methods/event_driven/staged_substep.h"

namespace constraint_sim::engine {

/// Advances a small group of bodies that may touch, with the joints on them, from event to event:
/// flight with watched gaps, impacts, resting contacts as rows that stick or slip, and one-sided
/// laws of coordinates as in EventDriven. Results depend only on the states of bodies and on what
/// joint states report of motors; between intervals only impulses accumulate. README.md of this
/// folder lists the owners of the parts in the order of their calls.
class ContactEvents {
 public:
  /// Bodies, joints and pairs of the group; set before begin(), without contacts.
  ContactEquations& equations() { return equations_; }
  List<ContactPair>& pairs() { return pairs_.list(); }

  /// Finds the contacts, all open, and clears the results. Returns false where two shapes overlap
  /// by more than ContactTolerances::overlap, unless the first interval `closes` overlaps.
  bool begin(const List<BodyState>& states, bool closes);
  /// Advances the group as IntervalMethod describes. Gives up after too much work, or at an event
  /// without a solution; the states are then those of IntegrationResult::found. `joint_step`,
  /// `joint_states`: step that contains the interval, and states of all joints. `most_work`: limit
  /// for the step, as work().
  IntegrationResult advance(const Interval& interval, const IntegratorOptions& options,
                            const JointStep& joint_step, const List<JointData>& joint_states,
                            double most_work, List<BodyState>* states);

  // ---- results since begin()
  std::uint32_t events() const { return stepper_.events(); }
  double work() const { return solver_.work(); }  ///< cost, in substeps of a group of one point
  const List<ContactPair>& pairs() const { return pairs_.list(); }
  const ContactEquations& equations() const { return equations_; }
  const ContactReports& reports() const { return reports_; }

 private:
  using Acts = ContactEquations::Acts;
  using Watched = ContactWatched;
  /// Counts since begin().
  struct Done {
    std::uint32_t breaks = 0, jams = 0;
    int missed = 0;             ///< substeps rejected for overlaps of boxes or for poor accuracy
    bool has_advanced = false;  ///< an interval was advanced
  };
  /// State of advance().
  struct Run {
    const Interval& interval;
    const IntegratorOptions& options;
    RemainingInterval left;
    IntegrationResult progress;
  };

  void begin_joints(const JointStep& step, const List<JointData>& states);
  void integrate(Run* run);
  void return_to_found(double t, Run* run);
  double* derivative();

  // ---- between events
  void watch(List<Watched>* list);
  bool take(int order, double tolerance, Run* run, RemainingInterval* left, double* step);
  bool rotate_little(double h);
  bool take_uniform(Run* run, RemainingInterval* left, double* step);
  void return_to_start(double t);
  bool repeat(Run* run, double t, double h);
  bool advance_to_event(Run* run);
  bool end_jam(Run* run);
  bool go_straight(bool is_straight);
  bool take_first(Run* run, RemainingInterval* left, double* step);

  // ---- at events
  bool change_states(Run* run, const Watched& event, bool* is_changed);
  void end_rattling(Run* run, const Watched& event);
  bool coarsen(double least, Run* run);
  bool settle(Run* run, const Watched& event, bool is_begin, bool jams = false);
  void report(double interval_start, double t, bool is_begin);
  void break_joint(const Run& run, std::size_t joint);
  bool break_hit(Run* run);
  bool break_overloaded(Run* run);

  ContactEquations equations_;
  ContactPairs pairs_;
  List<double> numbers_;          // storage of StageMemory
  List<double> kept_;             // state and derivative at the start of the substep
  double kept_at_ = -1.0;         // time of this start in the interval [s]
  std::size_t reports_kept_ = 0;  // events reported until then
  double step_ = 0.0;             // first guess of the next substep [s]
  int order_ = 8;                 // order of the last substep
  bool may_be_uniform_ = true;    // no accelerations have changed since the last event
  StagedSubstep last_;            // last substep, where its stages are known
  bool closes_ = false;           // whether the next interval closes overlaps
  ContactWatch watch_;
  EventStepper<Watched> stepper_;
  Done done_;
  double error_ = 0.0;  // estimated error of the last repeated substep [m]
  CountedSolver solver_;
  OverlapClosing closing_;
  ContactImpacts impacts_;
  ContactStates states_;
  ContactReports reports_;
  Rattling rattling_;
  UnchangedInterval unchanged_;

  List<double> before_projection_;
  GroupMotions rates_;  // scratch
};
static_assert(
    IntervalMethod<ContactEvents, const JointStep&, const List<JointData>&, double>::kIsHeld);

}  // namespace constraint_sim::engine
