#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// Relative motion of two surfaces along each other at a contact point.
enum class ContactState : std::uint8_t {
  kClosed,    ///< no friction, or touched within the step only, as in a bounce
  kSticking,  ///< held by friction
  kSlipping,  ///< friction at its limit, against the slip
};
inline constexpr auto kContactStateCount = static_cast<std::size_t>(ContactState::kSlipping) + 1;
/// Name as in messages: `closed`, `sticking`, `slipping`.
const char* name(ContactState state);

/// A point in which two bodies touched in the step.
struct Contact {
  BodyId body_a;
  BodyId body_b;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< point on B's surface, world [m]
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();   ///< unit vector from B to A, world
  double depth = 0.0;         ///< penetration [m]; negative for a gap that the step closed
  double normal_force = 0.0;  ///< normal force, mean over the step [N] ≥ 0
  /// Normal force and friction on A, world, mean over the step [N].
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  ContactState state = ContactState::kClosed;  ///< state at the end of the step
  int part_a = 0, part_b = 0;  ///< numbers of the shapes in their bodies, 0 unless compounds
};

/// Contact manifold of a pair of convex shapes: a common normal and up to eight points.
struct Manifold {
  struct Point {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< point on B's surface, world [m]
    double depth = 0.0;                                  ///< penetration [m]; negative for a gap
    /// Identifies the vertex, edge or face of the point; equal from step to step.
    std::uint32_t feature = 0;
  };

  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit vector from B to A, world
  int count = 0;                                      ///< number of points used; 0: no contact
  std::array<Point, 8> points;
};

}  // namespace constraint_sim::engine
