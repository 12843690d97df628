#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// One point in which two bodies press on each other.
struct Contact {
  BodyId body_a;
  BodyId body_b;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< on B's surface, world [m]
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();   ///< unit, from B to A, world
  double depth = 0.0;                                  ///< penetration [m] > 0
  double normal_force = 0.0;                           ///< mean over the step [N] ≥ 0
};

/// What the narrowphase finds for one pair of shapes: a common normal and up to eight points.
struct Manifold {
  struct Point {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< on B's surface, world [m]
    double depth = 0.0;                                  ///< penetration [m]; of a gap negative
    std::uint32_t feature = 0;  ///< which vertex, edge or face made it: the same from step to step
  };

  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit, from B to A, world
  int count = 0;                                      ///< of points used; 0: no contact
  std::array<Point, 8> points;
};

}  // namespace constraint_sim::engine
