#pragma once

#include "engine/dynamics/method.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"

namespace constraint_sim::engine {

/// Remembers an interval in which a contact group did not move. An interval whose start has the
/// same bits ends with the same bits, and is not computed again.
class UnchangedInterval {
 public:
  /// Whether `span` starts like the remembered interval. False with joints, whose forces depend on
  /// more than bodies and pairs.
  bool is_repeated_by(const Interval& span, const ContactEquations& equations,
                      const List<ContactPair>& pairs) const;
  /// Forgets the remembered interval, and notes the start of `span`.
  void begin(const Interval& span, const ContactEquations& equations,
             const List<ContactPair>& pairs);
  /// Remembers the interval that begin() noted, in which nothing has moved.
  void end(const ContactEquations& equations);
  /// Takes over contacts and bodies at the end of the remembered interval.
  void repeat(ContactEquations* equations) const;

 private:
  bool is_known_ = false;
  Eigen::Vector3d gravity_{0, 0, 0};
  double h_ = 0.0;
  List<double> numbers_;  // state of the movable bodies at the start
  List<GroupBody> bodies_;
  List<GroupShape> shapes_;
  List<ContactPair> pairs_;
  List<BodyState> states_;                    // at the end
  List<ContactEquations::Contact> contacts_;  // at the end
};

}  // namespace constraint_sim::engine
