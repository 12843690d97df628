#pragma once

#include <cstdint>

#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/report.h"

namespace constraint_sim::engine {

/// MethodReason an island is carried by the method it has.
enum class MethodReason {
  kSmooth,           ///< nothing in it jumps
  kAskedFor,         ///< the options name the method
  kContact,          ///< one of its bodies touches another
  kLimit,            ///< a joint with limits: rope, strut
  kForceLimit,       ///< a motor with a force limit
  kFriction,         ///< friction in a joint
  kStiff,            ///< joints or springs move its bodies faster than substeps are worth
  kInconsistent,     ///< joints contradict each other: met by least squares
  kRefused,          ///< nothing else could carry it
  kAtRest,           ///< nothing moves in it: it is left out until something touches it
  kBreaks,           ///< a joint that can break
  kLimitedSpring,    ///< a spring or servo with a force limit that is too stiff for events, or that
                     ///< also has limits of its length
  kManyRows,         ///< more limits, motors and friction than events are worth
  kFewContacts,      ///< may touch others within the step, and these are few: by events
  kContactsGivenUp,  ///< the same, but events found no answer, or did not come to an end
  kManyContacts,     ///< touches others, and there are too many bodies or points for events
  kOverlap,          ///< touches others, deeper than events begin with
};

/// In words.
const char* to_string(MethodReason why);

/// Dynamic bodies that joints connect, directly or by others; one on its own is an island too. What
/// the last step did with it.
struct Island {
  BodyId first_body;  ///< the first of them to be added
  std::uint32_t bodies = 0;
  std::uint32_t joints = 0;  ///< that are enabled and not broken
  Method method = Method::kSequentialImpulses;
  MethodReason why = MethodReason::kAskedFor;
  double local_error = 0.0;  ///< estimate for the step [m]; NaN where the method has none
  std::uint32_t substeps = 0;
  std::uint32_t rejected = 0;           ///< substeps tried in vain
  std::uint32_t iterations = 0;         ///< Newton's; 0 where the method has none
  std::uint32_t events = 0;             ///< at which a one-sided row began or ceased to act
  std::uint32_t unresolved_bodies = 0;  ///< that are moved faster than the step can show: they are
                                        ///< off, though joints and energy are kept
  std::uint32_t dependent_rows = 0;     ///< most equations at once that followed from others
};

}  // namespace constraint_sim::engine
