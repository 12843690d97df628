#pragma once

#include "engine/dynamics/kernels/tree_closings.h"

namespace constraint_sim::engine {

/// Writes the forces of the joints of trees, by unknown of the equations, after
/// TreeDynamics::find_transmitted(). `work` has a number per motion.
void write_transmitted_forces(const TreeInInterval& in, double* work, double* forces);

}  // namespace constraint_sim::engine
