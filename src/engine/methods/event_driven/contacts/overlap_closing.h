#pragma once

#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"
#include "engine/methods/event_driven/contacts/contact_problem.h"
#include "engine/methods/event_driven/contacts/counted_solver.h"

namespace constraint_sim::engine {

/// Closes overlaps that another method has left, before a contact group is advanced by events.
///
/// It finds the least change Σ m ‖Δx‖² + Δφ·I Δφ of positions after which no shapes overlap and the
/// joints hold. Each round linearizes the overlaps found by the narrowphase and solves the cone
/// problem of impulses without friction, with gaps in place of velocities.
class OverlapClosing {
 public:
  /// Moves the bodies, removes the contacts, and adds the change of energy to `corrected` [J].
  /// Returns false where rounds do not converge, or would push a joint beyond its limits.
  bool close(const ContactPairs& pairs, CountedSolver* solver, ContactEquations* equations,
             double* corrected);

 private:
  bool close_found(bool met, CountedSolver* solver, ContactEquations* equations);

  ContactProblem problem_;
};

}  // namespace constraint_sim::engine
