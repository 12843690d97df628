#pragma once

#include <cstdint>

#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/report.h"

namespace constraint_sim::engine {

/// Reason for the method of an island.
enum class MethodReason {
  kSmooth,        ///< no jumps of forces or velocities
  kAskedFor,      ///< the options name the method
  kContact,       ///< a body touches another one
  kLimit,         ///< a joint with limits: rope, strut
  kForceLimit,    ///< a motor with a force limit
  kFriction,      ///< friction in a joint
  kStiff,         ///< joints or springs move bodies so fast that substeps would cost more
  kInconsistent,  ///< joints contradict each other; solved by least squares
  kRefused,       ///< integration did not reach the tolerance
  kAtRest,        ///< no motion; the island is skipped until something touches it
  kBreaks,        ///< a joint that can break
  /// A spring or servo with a force limit that is too stiff for event-driven integration, or that
  /// has limits of its length too.
  kLimitedSpring,
  /// Too many coordinates with friction or a force limit, or too many ropes in loops, for
  /// event-driven integration.
  kManyRows,
  /// Few contacts, or few bodies close enough to touch within the step; event-driven.
  kFewContacts,
  kContactsGivenUp,  ///< event-driven contacts found no solution, or too many events
  kManyContacts,     ///< contacts with too many bodies or points for event-driven integration
  kOverlap,          ///< contacts that overlap too deeply for event-driven integration
};

/// Describes the reason in words.
const char* to_string(MethodReason why);

/// A connected component of dynamic bodies and the joints between them, or a single body without
/// joints, with the method and the figures of the last step.
struct Island {
  BodyId first_body;  ///< first body in the order of adding
  std::uint32_t bodies = 0;
  std::uint32_t joints = 0;  ///< enabled joints that are not broken
  Method method = Method::kSequentialImpulses;
  MethodReason why = MethodReason::kAskedFor;
  /// Estimate of the error of the step [m]; NaN where there is none, as in StepReport.
  double local_error = 0.0;
  std::uint32_t substeps = 0;
  std::uint32_t rejected = 0;     ///< rejected substeps
  std::uint32_t evaluations = 0;  ///< evaluations of the equations of motion in explicit substeps
  std::uint32_t iterations = 0;   ///< Newton iterations; 0 where the method has none
  std::uint32_t events = 0;       ///< moments at which a one-sided row began or ceased to act
  /// Bodies that move too fast for the time step: their motion is inaccurate, though joints hold
  /// and energy is conserved.
  std::uint32_t unresolved_bodies = 0;
  std::uint32_t dependent_rows = 0;  ///< largest number of redundant equations at any time
};

}  // namespace constraint_sim::engine
