#pragma once

#include <Eigen/Core>
#include <algorithm>

#include "engine/dynamics/regularized_rows.h"

namespace constraint_sim::engine {

/// Share of the weights on the diagonal where a right-hand side can be met.
inline constexpr double kLeastShare = 1e-11;
/// Share of the scene's size; a smaller change is rounding where it exceeds half of the change
/// before.
inline constexpr double kChangeRounding = 1e-10;
/// Share of the scene's size that runge_kutta can project.
inline constexpr double kReachable = 1e-10;

inline void clear(BodyVectors* u) {
  for (auto* list : {&u->linear, &u->angular})
    std::fill(list->begin(), list->end(), Eigen::Vector3d::Zero());
}

}  // namespace constraint_sim::engine
