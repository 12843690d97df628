#pragma once

#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/tree_dynamics.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Reads positions and rates of all motions from the bodies where the equations were evaluated
/// last. `roots`: per body, the root of its tree. Whole turns are taken from CoordinatePositions.
void read_tree(const EquationsOfMotion& equations, const JointTree& tree,
               const List<TreeRoot>& roots, double* y);

}  // namespace constraint_sim::engine
