#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "constraint_sim/engine/contact.h"
#include "constraint_sim/engine/id.h"
#include "engine/math/list.h"
#include "engine/model/shape_pair.h"

namespace constraint_sim::engine {

/// Two convex shapes of bodies in contact, with the contact impulses of the last step. A pair that
/// is about to hit has no points.
struct TouchingPair {
  static std::array<Eigen::Vector3d, 8> no_impulses() {
    std::array<Eigen::Vector3d, 8> impulses;
    impulses.fill(Eigen::Vector3d::Zero());
    return impulses;
  }

  int a = 0, b = 0;
  BodyId id_a, id_b;           ///< ids stay when removals move the indices
  int part_a = 0, part_b = 0;  ///< numbers of the shapes in their bodies
  Manifold manifold;
  /// Impulse of each point on A, world [N s].
  std::array<Eigen::Vector3d, 8> impulses = no_impulses();
  std::array<ContactState, 8> contact_states{};  ///< state of each point after the last step

  std::pair<int, int> ends() const { return {a, b}; }
  ShapePair shapes() const { return {a, b, part_a, part_b}; }
  /// Orders pairs by the indices of their bodies, then by their parts.
  static bool in_order(const TouchingPair& l, const TouchingPair& r) {
    return l.shapes() < r.shapes();
  }
  /// Returns the impulse of the point with this feature in the last step; zero for a new point.
  Eigen::Vector3d impulse_of(std::uint32_t feature) const {
    for (std::size_t k = 0; k < to_index(manifold.count); ++k)
      if (manifold.points[k].feature == feature) return impulses[k];
    return Eigen::Vector3d::Zero();
  }
};

}  // namespace constraint_sim::engine
