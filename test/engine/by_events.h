#pragma once

#include "support.h"

namespace constraint_sim::engine {

// ---- what tests of contacts from event to event share

inline constexpr double kPlace = 1e-12;  ///< [m] of what is in closed form within a tick, too
inline constexpr double kTime = 1e-12;   ///< [s]

inline WorldOptions by_events(double time_step, double gravity = kGravity) {
  WorldOptions options = engine::options(time_step, gravity);
  options.method = Method::kEventDriven;
  options.tolerance = 1e-10;
  return options;
}

inline Body with_surface(Body body, double friction, double restitution) {
  body.friction = friction;
  body.restitution = restitution;
  return body;
}

}  // namespace constraint_sim::engine
