#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/kernels/tree_closings.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

// Bodies of trees as TreeDynamics has placed them; `root`: position of a free root [m].

/// Writes to the bodies of the world.
void scatter_tree(const TreeInInterval& in, const Eigen::Vector3d& root, List<BodyState>* states);

/// Writes a state of the equations.
void write_tree_state(const TreeInInterval& in, const Eigen::Vector3d& root, double* y);

}  // namespace constraint_sim::engine
