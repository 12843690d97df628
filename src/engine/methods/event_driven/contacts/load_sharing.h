#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"
#include "engine/methods/event_driven/contacts/contact_problem.h"
#include "engine/methods/event_driven/contacts/counted_solver.h"

namespace constraint_sim::engine {

/// Shares the load of redundant contacts, so that contacts that yield together reach their bounds
/// together.
///
/// Where least-norm forces violate their bounds, the cone problem gives forces within bounds; but
/// some forces are at a bound, and would exceed it a moment later although other contacts can bear
/// more. Newton's method moves these forces towards the analytic centre of all equivalent forces,
/// the minimum of Σ −log(μ² f_n² − f_t²) over sticking and −log f_n over slipping contacts, while
/// the least margin grows. Later changes are shared in proportion to normal forces.
class LoadSharing {
 public:
  /// Moves the forces of `problem` away from their bounds without changing their effect, and sets
  /// the shares of later changes in the contacts of `equations`. Returns the largest change of an
  /// acceleration of a contact [m/s²]: contacts that slip in different directions make friction
  /// depend on the sharing, which rigid bodies leave open.
  double share(const ContactPairs& pairs, CountedSolver* solver, ContactProblem* problem,
               ContactEquations* equations);

 private:
  /// Loaded contact.
  struct Share {
    std::size_t contact;
    std::size_t column;  ///< column of the normal force
    double friction;
    bool is_rough, sticks;
    Eigen::Vector2d direction;  ///< slip direction along the tangents
  };

  void list_contacts(const ContactProblem& problem, const ContactEquations& equations);
  double mean_beside(const ContactPairs& pairs, const Share& of, const List<double>& force) const;
  double least_margin(const ContactPairs& pairs, const List<double>& force) const;
  bool find_step(const ContactPairs& pairs, const ContactProblem& problem,
                 const ContactEquations& equations, double beyond);

  List<Share> shares_;
  List<double> step_;  // search direction, per column
  LeastNormSolver factors_;
};

}  // namespace constraint_sim::engine
