#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// How the two surfaces move along each other where they touch.
enum class ContactState : std::uint8_t {
  kClosed,    ///< without friction, or touched within the step only, as in a bounce
  kSticking,  ///< held by friction
  kSlipping,  ///< friction at its limit, against the slip
};
/// As in messages: `closed`, `sticking`, `slipping`.
const char* name(ContactState state);

/// One point in which two bodies press on each other.
struct Contact {
  BodyId body_a;
  BodyId body_b;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< on B's surface, world [m]
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();   ///< unit, from B to A, world
  double depth = 0.0;                                  ///< penetration [m] > 0
  double normal_force = 0.0;                           ///< mean over the step [N] ≥ 0
  Eigen::Vector3d force = Eigen::Vector3d::Zero();  ///< normal and friction, on A, world [N]; mean
  ContactState state = ContactState::kClosed;       ///< at the end of the step
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
