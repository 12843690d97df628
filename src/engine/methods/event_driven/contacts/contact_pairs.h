#pragma once

#include <cstddef>
#include <variant>

#include "constraint_sim/engine/shape.h"
#include "engine/collision/contact_feature.h"
#include "engine/collision/contact_tolerances.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"

namespace constraint_sim::engine {

/// Two convex shapes of different bodies that may touch, with A first as has_features() requires.
/// Contacts of a pair are consecutive.
struct ContactPair {
  std::size_t a, b;                          ///< bodies, by index in GroupBodies::list()
  std::size_t shape_index_a, shape_index_b;  ///< shapes, by index in GroupBodies::shapes()
  Shape shape_a, shape_b;
  double friction, restitution;
  std::size_t first = 0, count = 0;  ///< range of its contacts
  double thickness = 0.0;            ///< thickness of the thinner shape [m]
  double assumed_speed = 0.0;        ///< mean speed of approach that the step assumes [m/s]
  bool touched = false;              ///< during the previous step
  bool held = false, stuck = false;  ///< state at the end of the previous step
  bool is_still = false;             ///< some contact did not slip, at the end of the previous step

  bool is_of_boxes() const {
    return std::holds_alternative<Box>(shape_a) && std::holds_alternative<Box>(shape_b);
  }
  bool has_bodies_of(const ContactPair& other) const {
    return (a == other.a && b == other.b) || (a == other.b && b == other.a);
  }
  /// Whether the features in contact do not depend on the pose.
  bool has_fixed_features() const { return !std::visit(HasBorders{}, shape_b); }
  /// Forgets the state at the end of the previous step.
  void forget() { held = stuck = is_still = false; }
};

/// Keeps the features at which the pairs of a contact group may touch, and finds overlaps that no
/// feature has shown.
class ContactPairs {
 public:
  /// Largest number of points at which two shapes touch.
  static std::size_t most_points(const Shape& a, const Shape& b);

  List<ContactPair>& list() { return pairs_; }
  const List<ContactPair>& list() const { return pairs_; }
  const ContactPair& of(std::size_t contact) const { return pairs_[pair_of_[contact]]; }
  bool are_of_one(std::size_t contact, std::size_t other) const {
    return pair_of_[contact] == pair_of_[other];
  }

  /// Tolerances of all contacts of the group: tolerances of its smallest shape.
  const ContactTolerances& tolerances() const { return tolerances_; }
  /// Counts speeds up to `least` as zero, until begin(). Returns false where that is too much.
  bool coarsen(double least) { return tolerances_.coarsen(least); }

  /// Sets the tolerances, adds the contacts of all pairs, open, and notes which pairs touched in
  /// the previous step. Returns false where two shapes overlap by more than
  /// ContactTolerances::overlap, unless the first interval `closes` overlaps.
  bool begin(bool closes, ContactEquations* equations);
  /// Updates the features of all pairs. Acting contacts keep their features, unless `all`. Inside
  /// a substep (`is_within`) features of two boxes stay unchanged.
  void find_features(bool all, bool is_within, ContactEquations* equations);
  /// Whether bodies overlap unnoticed. Two boxes may have met with features that were not watched,
  /// and no event may be late.
  bool has_missed(const ContactEquations& equations);
  /// Longest substep in which no body passes through another and no corner makes a whole turn
  /// between two evaluations of gaps; at most `left` [s].
  double longest_substep(double left, const ContactEquations& equations) const;

 private:
  void add_contacts(ContactEquations* equations);
  void note_step_before(const ContactMotion& now, ContactPair* pair) const;

  /// Overlaps per pair [m].
  struct Depths {
    List<double> at_start, at_end;  ///< at the start and the end of the substep
  };

  List<ContactPair> pairs_;
  List<std::size_t> pair_of_;  // per contact
  ContactTolerances tolerances_;
  Depths depths_;
  List<ContactFeature> found_;  // scratch
};

}  // namespace constraint_sim::engine
