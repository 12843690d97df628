#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "constraint_sim/engine/event.h"
#include "engine/constraints/joint.h"
#include "engine/dynamics/method.h"
#include "engine/math/cone_problem.h"
#include "engine/math/integrate.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"
#include "engine/methods/event_driven/contacts/contact_problem.h"
#include "engine/methods/event_driven/contacts/contact_reports.h"
#include "engine/methods/event_driven/contacts/contact_watch.h"
#include "engine/methods/event_driven/contacts/counted_solver.h"
#include "engine/methods/event_driven/contacts/load_sharing.h"
#include "engine/methods/event_driven/contacts/overlap_closing.h"
#include "engine/methods/event_driven/contacts/unchanged_interval.h"
#include "engine/methods/event_driven/joints/event_watch.h"

namespace constraint_sim::engine {

/// Advances a small group of bodies that may touch, with the joints on them, from event to event:
/// flight with watched gaps, impacts, resting contacts as rows that stick or slip, and one-sided
/// laws of coordinates as in EventDriven. Results depend only on the states of bodies and on what
/// joint states report of motors; between intervals only impulses accumulate.
class ContactEvents {
 public:
  static constexpr std::size_t kMostLaws = 32;  ///< groups with more coordinates use another method
  static constexpr std::uint32_t kMostEvents = 5000;  ///< per step
  static constexpr double kSlipping = 1e-9;  ///< [m/s]; a slower slip has no direction of its own

  /// Bodies, joints and pairs of the group; set before begin(), without contacts.
  ContactEquations& equations() { return equations_; }
  List<ContactPair>& pairs() { return pairs_.list(); }

  /// Finds the contacts, all open, and clears the results. Returns false where two shapes overlap
  /// by more than ContactPairs::kMostOverlap, unless the first interval `closes` overlaps.
  bool begin(const List<BodyState>& states, bool closes);
  /// Advances the group as method.h describes. Gives up after too many events, or at an event
  /// without a solution; the states are then those of any time in the interval. `joint_step`,
  /// `joint_states`: step that contains the interval, and states of all joints. `most_work`: limit
  /// for the step, as work().
  IntegrationResult advance(const Interval& span, const IntegratorOptions& accuracy,
                            const JointStep& joint_step, const List<JointState>& joint_states,
                            double most_work, List<BodyState>* states);

  // ---- results since begin()
  std::uint32_t events() const { return done_.events; }
  double driven_work() const { return equations_.driven_work; }  ///< work of kinematic bodies [J]
  double work() const { return solver_.work(); }  ///< cost, in substeps of a group of one point
  const List<ContactPair>& pairs() const { return pairs_.list(); }
  const ContactEquations& equations() const { return equations_; }
  /// Whether a contact acts now, or had an impulse in this step.
  bool has_touched(std::size_t contact) const;
  const ContactReports& reports() const { return reports_; }

 private:
  using Acts = ContactEquations::Acts;
  using Watched = ContactWatched;
  /// Limit in an impact. `direction`: +1 for a lower limit, −1 for an upper limit.
  struct LimitHit {
    std::size_t coordinate;
    double direction;
    double gap, rate;
    double restitution;
  };
  struct ContactHit {
    std::size_t contact;
    ContactMotion motion;
  };
  struct Hits {
    List<ContactHit> contacts;
    List<LimitHit> limits;

    bool empty() const { return contacts.empty() && limits.empty(); }
    void clear() {
      contacts.clear();
      limits.clear();
    }
  };
  /// State before the impacts, to repeat them.
  struct BeforeImpacts {
    List<double> numbers;
    double driven_work = 0.0;
    List<ContactEquations::Contact> contacts;
    List<ContactEquations::BodyJoint> joints;
    List<ContactEquations::Coordinate> coordinates;
  };
  /// Coordinate that moves at the rate of a law that may hold it.
  struct Candidate {
    std::size_t coordinate;
    Hold hold;
    double rate, acceleration;
    ForceBounds bounds;
  };
  /// Contacts whose force has just reached a bound.
  struct AtBound {
    List<std::size_t> contacts;
    double since = 0.0;  ///< time of the first of them [s]

    bool has(std::size_t contact) const {
      return std::find(contacts.begin(), contacts.end(), contact) != contacts.end();
    }
  };
  /// Counts since begin().
  struct Done {
    std::uint32_t events = 0, impacts = 0, breaks = 0, jams = 0;
    int unchanged = 0;   ///< events that changed nothing
    int missed = 0;      ///< substeps rejected for overlaps of boxes or for poor accuracy
    bool spans = false;  ///< an interval was advanced
  };
  struct Span {
    const Interval& all;
    const IntegratorOptions& accuracy;
    SubstepSpan left;
    IntegrationResult progress;
  };

  void begin_joints(const Span& span, const JointStep& step, const List<JointState>& states);
  void note_angles();
  void give_way(std::size_t coordinate);
  bool has_changed() const;
  double* derivative();

  // ---- between events
  void set_directions();
  void watch(List<Watched>* list);
  bool take(Span* span, SubstepSpan* left, double tolerance, double* step);
  bool repeat(Span* span, double t, double h, bool is_start);
  bool advance_to_event(Span* span);
  bool end_jam(Span* span);
  bool finish_event(Span* span, const Watched& watched, std::size_t which);

  // ---- slow slips (contact_straight.cpp)
  bool turns_fast(double h) const;
  bool was_straight(double h, double tolerance) const;
  bool go_straight(bool is_straight);
  bool take_first(Span* span, double* step);

  // ---- at events (contact_states.cpp)
  bool settle(Span* span, const Watched& event, bool is_begin, bool jams = false);
  bool have_impacts(double left, PerRow<double>* hit);
  bool is_hit(double gap, double rate) const;
  void find_hits(const PerRow<char>& rests, Hits* hits) const;
  void add_touching_limits(const PerRow<char>& rests, bool only_slow, List<LimitHit>* hits) const;
  std::pair<std::size_t, std::size_t> bodies_of(const ContactEquations::Coordinate& of) const;
  bool have_impact(const Hits& hits, const PerRow<char>& rests, double faster, PerRow<double>* hit);
  bool does_work(const ContactEquations::Responses& responses) const;
  bool have_jam(PerRow<double>* hit);
  bool let_rest(double left, const PerRow<double>& hit, PerRow<char>* rests, bool* is_settled);
  void break_joint(const Span& span, std::size_t joint);
  bool break_overloaded(Span* span);
  void note_bounds(const Span& span, const Watched& event);
  bool decide(const Watched& event);
  bool decide(const Watched& event, double least_slip);
  void find_lost();
  double braking_of(std::size_t coordinate);
  void choose_servos();
  bool find_candidates(List<Candidate>* candidates);
  void set_problem(double least_slip);
  void choose_acts();
  void find_solved_accelerations();
  void choose_holds(const Watched& event);
  void take_forces();
  bool is_within_bounds();
  void hold_coordinates(bool is_begin);

  ContactEquations equations_;
  ContactPairs pairs_;
  List<double> numbers_;     // storage of StageMemory
  List<double> kept_;        // state and derivative at the start of the substep
  double step_ = 0.0;        // first guess of the next substep [s]
  bool has_stages_ = false;  // whether stages of the last substep are stored
  bool closes_ = false;      // whether the next interval closes overlaps
  bool begins_ = false;      // whether settle() is at the start of an interval
  ContactEquations::Accelerations rates_;
  List<double> gap_acceleration_;         // per contact, as of decide()
  List<double> coordinate_acceleration_;  // per coordinate, as of decide()
  List<OneSidedState> states_before_;     // per coordinate, before the event
  PerRow<double> rests_in_;               // times until bounces that are not followed are over [s]
  ContactWatch watch_;
  WatchedSubstep<Watched> watched_;
  Done done_;
  double error_ = 0.0;  // estimated error of the last repeated substep [m]
  CountedSolver solver_;
  OverlapClosing closing_;
  AtBound at_cone_, at_zero_;  // contacts at the friction bound, and at zero normal force
  ContactReports reports_;
  UnchangedInterval unchanged_;

  // ---- storage for one event
  ContactProblem problem_;
  List<double> rate_, solved_;  // rates before and rates after, of problem_
  LoadSharing sharing_;
  List<Candidate> held_;
  Hits hits_;
  PerRow<char> rests_;
  PerRow<double> hit_;
  BeforeImpacts before_impacts_;
  List<Acts> acts_before_;
  List<std::uint32_t> features_before_;  // ids of features
  List<Watched> forces_;
  List<double> free_;            // derivative without acting rows, or with the chosen states
  bool has_derivative_ = false;  // whether free_ is the derivative with the chosen states
  List<double> before_projection_;
};

}  // namespace constraint_sim::engine
