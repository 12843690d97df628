#pragma once

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// The method of islands that only impulses can advance.
inline Method impulses_of(const WorldOptions& options) {
  return options.method == Method::kSequentialImpulses ? Method::kSequentialImpulses
                                                       : Method::kTimeStepping;
}

/// Whether impulses are solved to a tolerance, and contacts may have a gap.
inline bool solves_impulses(const WorldOptions& options) {
  return impulses_of(options) == Method::kTimeStepping;
}

/// Whether steps of contacts are divided to keep their errors within a tolerance.
inline bool controls_contacts(const WorldOptions& options) {
  return solves_impulses(options) && options.contact_tolerance > 0.0;
}

}  // namespace constraint_sim::engine
