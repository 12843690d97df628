#pragma once

#include <Eigen/Core>
#include <limits>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// A force and torque on a body for an interval of simulated time.
struct Wrench {
  BodyId body;                                      ///< a dynamic body
  Eigen::Vector3d force = Eigen::Vector3d::Zero();  ///< force at the centre of mass, world axes [N]
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();  ///< torque, world axes [N m]
  double start = 0.0;                                ///< simulated time [s]
  /// Simulated time [s] > start, or infinite.
  double end = std::numeric_limits<double>::infinity();
};

}  // namespace constraint_sim::engine
