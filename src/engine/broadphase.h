#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <utility>
#include <vector>

#include "constraint_sim/body.h"

namespace constraint_sim {

/// Axis-aligned bounding box in world coordinates [m]. Of a plane it is infinite.
struct Aabb {
  Eigen::Vector3d min;
  Eigen::Vector3d max;
};

/// Whether two boxes share a point, touching included; stops at the first axis that separates them.
bool overlap(const Aabb& a, const Aabb& b);

/// The smallest box around a shape.
Aabb bounds(const Shape& shape, const BodyState& state);

/// A body in the eyes of the broadphase.
struct Proxy {
  Aabb box;
  int body = 0;          ///< index, unique among the proxies
  bool movable = false;  ///< two immovable ones make no pair
};

/// Stage 1 of a step: which bodies may touch.
class Broadphase {
 public:
  using Pair = std::pair<int, int>;  ///< body indices, first < second

  /// All pairs with at least one movable body whose boxes overlap, sorted. Valid until the next call.
  const std::vector<Pair>& find_pairs(const std::vector<Proxy>& proxies);

  /// Box against box tests of the last call.
  std::uint64_t tests() const { return tests_; }

 private:
  std::vector<Pair> pairs_;
  std::uint64_t tests_ = 0;
};

}  // namespace constraint_sim
