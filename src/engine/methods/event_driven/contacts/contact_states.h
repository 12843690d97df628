#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "engine/constraints/one_sided_law.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"
#include "engine/methods/event_driven/contacts/contact_problem.h"
#include "engine/methods/event_driven/contacts/contact_watch.h"
#include "engine/methods/event_driven/contacts/counted_solver.h"
#include "engine/methods/event_driven/contacts/load_sharing.h"

namespace constraint_sim::engine {

/// Decides at an event how each contact and coordinate of a group acts next.
///
/// With w the rates of contacts along normals and tangents, and A the response to impulses while
/// the joints hold: ẇ = b + A f for touching contacts that do not part, with f in its cone, or
/// along the slip for slipping contacts. Coordinates with one-sided laws are rows of the same
/// problem, as in event_problem.h.
class ContactStates {
 public:
  using Acts = ContactEquations::Acts;

  /// Forgets the contacts at a bound.
  void begin_step();
  /// Notes the states before an event.
  void begin_event(const ContactEquations& equations);
  /// Notes the contact that reaches a bound at an event at time t [s], in an interval of length h.
  /// Contacts that share a force reach their bounds together or shortly after each other; each
  /// yields in turn, and none sticks again before it has slipped.
  void note_bounds(double t, double h, const ContactWatched& event, const ContactPairs& pairs,
                   const ContactEquations& equations);
  /// Decides the states at the current pose and velocities, `y`. A contact whose force has left its
  /// bounds yields, as `event` says, where the force is still at the bound to rounding. Returns
  /// false where there is no solution.
  bool decide(const ContactWatched& event, const double* y, const ContactPairs& pairs,
              CountedSolver* solver, ContactEquations* equations);
  /// Sets where coordinates are held after the event. `is_begin`: at the start of an interval.
  void hold_coordinates(bool is_begin, ContactEquations* equations) const;

  // ---- states before the event
  const List<Acts>& acts_before() const { return acts_before_; }
  const List<OneSidedState>& coordinates_before() const { return coordinates_before_; }
  /// Whether any state differs from the states before the event.
  bool has_changed(const ContactEquations& equations) const;

  // ---- results of decide()
  /// Largest acceleration of a contact that the load sharing changes, since begin_event() [m/s²].
  double indeterminate() const { return indeterminate_; }
  /// Returns the accelerations of the bodies with the decided states.
  const GroupMotions& accelerations(const double* y, ContactEquations* equations);
  /// Derivative of `y` with the decided states; null where decide() has not needed it.
  const double* derivative() const { return has_derivative_ ? derivative_.data() : nullptr; }

 private:
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

  bool decide(const ContactWatched& event, double least_slip, const double* y,
              const ContactPairs& pairs, CountedSolver* solver, ContactEquations* equations);
  bool decide_once(const ContactWatched& event, double least_slip, const double* y,
                   const ContactPairs& pairs, CountedSolver* solver, ContactEquations* equations);
  void find_free_motion(const double* y, const ContactTolerances& within,
                        ContactEquations* equations);
  bool find_candidates(double resting, ContactEquations* equations);
  void set_problem(double least_slip, const ContactEquations& equations);
  void find_solved_accelerations();
  void choose_acts(ContactEquations* equations);
  void choose_holds(const ContactWatched& event, ContactEquations* equations);
  void choose_servos(ContactEquations* equations) const;
  bool is_within_bounds(const double* y, ContactEquations* equations);
  void take_forces(ContactEquations* equations) const;

  List<Acts> acts_before_;                  // per contact
  List<std::uint32_t> features_before_;     // ids of features, per contact
  List<OneSidedState> coordinates_before_;  // per coordinate
  double interval_ = 0.0;                   // length of the interval [s]
  AtBound at_cone_, at_zero_;  // contacts at the friction bound, and at zero normal force
  List<Candidate> candidates_;
  List<char> is_pressed_;  // per coordinate, as of find_pressed()
  ContactProblem problem_;
  List<double> solved_;                   // accelerations, as problem_.cone.b
  List<double> gap_acceleration_;         // per contact
  List<double> coordinate_acceleration_;  // per coordinate
  GroupMotions rates_;
  List<GroupForces> free_forces_;  // per joint: forces without acting contacts and laws
  LoadSharing sharing_;
  double indeterminate_ = 0.0;
  List<ContactWatched> forces_;  // margins of the decided states
  List<double> derivative_;      // without acting rows, or with the decided states
  bool has_derivative_ = false;  // whether derivative_ is with the decided states
};

}  // namespace constraint_sim::engine
