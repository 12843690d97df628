#pragma once

#include <cstddef>

#include "constraint_sim/engine/event.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"
#include "engine/methods/event_driven/contacts/per_row.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Change of a contact group at an event, as ContactReports reports it.
struct ContactChange {
  double interval_start, t;                  ///< simulated [s]
  bool is_begin;                             ///< whether the change is at the start of an interval
  const List<ContactEquations::Acts>& acts;  ///< per contact, before the change
  const List<OneSidedState>& states;         ///< per coordinate, before the change
  const PerRow<double>& impulses;            ///< impulses of impacts
  const PerRow<double>& rests_in;  ///< times until bounces that are not followed are over [s]
};

/// Reports the events of a contact group, by comparing states before and after each change.
class ContactReports {
 public:
  struct Report {
    EventKind kind;
    double time;     ///< simulated [s]
    int pair;        ///< first pair of shapes of the two bodies; −1: event of a joint
    int coordinate;  ///< index in ContactEquations, for events of joints
    double impulse;  ///< impulse of an impact [N s or N m s]
    int joint = -1;  ///< index in ContactEquations of a joint that broke
  };
  const List<Report>& list() const { return list_; }
  void clear() { list_.clear(); }
  /// Forgets all events but the first `count`.
  void keep(std::size_t count) { list_.resize(count); }

  /// Infers the states of coordinates before the step, as far as the motion shows them.
  void begin_step(const ContactEquations& equations);
  /// Notes the states of coordinates at the end of an interval.
  void end_interval(const ContactEquations& equations);
  void add_break(double t, std::size_t joint);
  /// Reports the change to the states in `equations`; at the start of an interval against the
  /// end of the interval before.
  void add(const ContactChange& change, const ContactEquations& equations, ContactPairs* pairs);
  /// Writes the positions where motors with a force limit hold, and whether these are saturated.
  void write(const ContactEquations& equations, std::size_t coordinate, JointData* state) const;

 private:
  void add_pairs(const ContactChange& change, const ContactEquations& equations, std::size_t first,
                 std::size_t last, List<ContactPair>* pairs);
  void add(const Report& report, double rests_in);

  List<Report> list_;
  List<OneSidedState> last_states_;  // per coordinate, at the end of the previous interval
  List<char> was_saturated_;         // per coordinate, at the end of the previous interval
};

}  // namespace constraint_sim::engine
