#pragma once

#include <array>
#include <cstddef>

#include "constraint_sim/engine/joint.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

// What couples coordinates of joints: Σ ratio q = constant, a row of up to four bodies. Its
// gradient, γ and discrete gradient are the weighted sums of those of the coordinates.

/// A coordinate in it.
struct CoupledTerm {
  std::size_t joint = 0;  ///< by index
  int coordinate = 0;     ///< of that joint
  double ratio = 1.0;
};
using CoupledTerms = std::array<CoupledTerm, 2>;

/// Metres a radian of a screw.
double lead(const Joint& screw);

/// Takes value and rate from the coordinates as they read now.
void read_coupling(const CoupledTerms& terms, const List<JointState>& states,
                   CouplingState* coupling);

/// Adds what it does along these coordinates [N or N m], once the joints are read.
void add_coupled_effort(const CoupledTerms& terms, double effort, List<JointState>* states);

}  // namespace constraint_sim::engine
