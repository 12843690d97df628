#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"

namespace constraint_sim::engine {

/// Returns the principal moments of inertia of a body: its own, or by mass and shape [kg m²].
inline Eigen::Vector3d inertia_of(const Body& body) {
  return body.inertia.isZero(0.0) ? Eigen::Vector3d(body.mass * unit_inertia(body.shape))
                                  : body.inertia;
}

}  // namespace constraint_sim::engine
