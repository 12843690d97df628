#pragma once

#include "engine/dynamics/interval.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"

namespace constraint_sim::engine {

/// Remembers an interval in which a contact group did not move. An interval whose start has the
/// same bits ends with the same bits, and is not computed again.
class UnchangedInterval {
 public:
  /// Whether `interval` starts like the remembered interval. Called after
  /// GroupJoints::begin_interval().
  bool is_repeated_by(const Interval& interval, const ContactEquations& equations,
                      const List<ContactPair>& pairs);
  /// Forgets the remembered interval, and notes the start of `interval`, after
  /// GroupJoints::begin_interval().
  void begin(const Interval& interval, const ContactEquations& equations,
             const List<ContactPair>& pairs);
  /// Remembers the interval that begin() noted, in which nothing has moved. `work`:
  /// CountedSolver::work() of the interval.
  void end(const ContactEquations& equations, const IntegrationResult& progress, double work);
  /// Takes over bodies, contacts, impulses and laws at the end of the remembered interval.
  void repeat(ContactEquations* equations) const;
  /// Progress and cost of the remembered interval.
  const IntegrationResult& progress() const { return progress_; }
  double work() const { return work_; }

 private:
  bool is_known_ = false;
  Eigen::Vector3d gravity_{0, 0, 0};
  double h_ = 0.0;
  List<double> numbers_;  // state of movable bodies and joints at the start
  List<GroupBody> bodies_;
  List<GroupShape> shapes_;
  List<ContactPair> pairs_;
  IntegrationResult progress_;
  double work_ = 0.0;
  List<BodyState> states_;                    // at the end
  List<ContactEquations::Contact> contacts_;  // at the end
  List<GroupJoint> joints_;                   // at the end
  List<GroupCoordinate> coordinates_;         // at the end
  List<double> numbers_now_;                  // scratch
};

}  // namespace constraint_sim::engine
