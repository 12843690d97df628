#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "engine/math/impulse_sharing.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"
#include "engine/methods/event_driven/contacts/contact_problem.h"
#include "engine/methods/event_driven/contacts/contact_states.h"
#include "engine/methods/event_driven/contacts/counted_solver.h"
#include "engine/methods/event_driven/contacts/per_row.h"
#include "engine/methods/event_driven/followed_bounces.h"

namespace constraint_sim::engine {

/// Solves the impacts of a contact group, of contacts and limits that are hit.
///
/// With w the rates of contacts along normals and tangents, and A the response to impulses while
/// the joints hold:
///   w⁺ = w + A p,  0 ≤ p_n ⊥ w_n⁺ + e w_n⁻ ≥ 0,  p in its friction cone
/// Coordinates with one-sided laws are rows of the same problem, as in event_problem.h.
class ContactImpacts {
 public:
  /// Clears impulses and times of rest.
  void begin_event(const ContactEquations& equations);
  /// Solves impacts one after the other until nothing is hit. Contacts and limits whose bounces are
  /// too low to be `followed` lose their restitution; then all impacts are repeated. `begins`: at
  /// the start of an interval an open gap is no hit, since early hits would end bounces too early.
  /// Changes the velocities in `y`, unless there is no solution, and then returns false.
  bool have_impacts(const FollowedBounces& followed, bool begins, const ContactPairs& pairs,
                    ContactStates* states, CountedSolver* solver, ContactEquations* equations,
                    double* y);
  /// Ends slips that friction drives into the other body (Painlevé), where no finite force
  /// suffices, by an impulse without restitution.
  bool have_jam(const ContactPairs& pairs, CountedSolver* solver, ContactEquations* equations,
                double* y);

  /// Fastest approach at the event [m/s].
  double approach() const { return approach_; }

  /// Number of times at which there were impacts.
  std::uint32_t count() const { return count_; }

  // ---- results since begin_event()
  const PerRow<double>& impulses() const { return results_.impulses; }
  /// Times until bounces that are not followed are over [s].
  const PerRow<double>& rests_in() const { return results_.rests_in; }
  /// Whether there are such bounces.
  bool any_rests() const {
    const auto is_rest = [](double time) { return time > 0.0; };
    const PerRow<double>& times = results_.rests_in;
    return std::any_of(times.contacts.begin(), times.contacts.end(), is_rest) ||
           std::any_of(times.coordinates.begin(), times.coordinates.end(), is_rest);
  }
  /// Rate of a contact that the impacts leave open, since it depends on the sharing of impulses
  /// [m/s].
  double indeterminate() const { return results_.indeterminate; }

 private:
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
    double approach = 0.0;  // fastest

    bool empty() const { return contacts.empty() && limits.empty(); }
    void clear() {
      contacts.clear();
      limits.clear();
      approach = 0.0;
    }
  };
  /// State before the impacts, to repeat them.
  struct Before {
    List<double> numbers;
    double driven_work = 0.0;
    List<ContactEquations::Contact> contacts;
    List<GroupJoint> joints;
    List<GroupCoordinate> coordinates;
  };

  /// Results since begin_event().
  struct Results {
    PerRow<double> impulses, rests_in;
    double indeterminate = 0.0;
  };

  bool solve_impacts(const FollowedBounces& followed, bool begins, const ContactPairs& pairs,
                     ContactStates* states, CountedSolver* solver, ContactEquations* equations,
                     double* y);
  void start_again(ContactEquations* equations, double* y);
  void keep(const ContactEquations& equations, const double* y);
  void restore(ContactEquations* equations, double* y) const;
  void find_hits(bool begins, const ContactPairs& pairs, const ContactEquations& equations);
  void add_touching_limits(bool only_slow, const ContactTolerances& within,
                           const ContactEquations& equations);
  bool have_impact(double faster, const ContactTolerances& within, CountedSolver* solver,
                   ContactEquations* equations, double* y);
  bool does_work() const;
  bool let_rest(const FollowedBounces& followed, const ContactPairs& pairs, ContactStates* states,
                CountedSolver* solver, ContactEquations* equations, const double* y,
                bool* is_settled);

  Hits hits_;           // hits of the next impact
  PerRow<char> rests_;  // rows that have lost their restitution
  ContactProblem problem_;
  List<double> rate_;  // rates before, per column of problem_
  Before before_;
  Results results_;
  double approach_ = 0.0;
  ImpulseSharing sharing_;
  std::uint32_t count_ = 0;
};

}  // namespace constraint_sim::engine
