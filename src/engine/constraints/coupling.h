#pragma once

#include <array>
#include <cstddef>

#include "constraint_sim/engine/joint.h"
#include "engine/math/list.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

// Couplings of coordinates of joints: Σ ratio q = constant, a row of up to four bodies. Its
// gradient, γ and discrete gradient are weighted sums over the coordinates.

/// A coordinate of a coupling, with its weight `ratio`.
struct CoupledTerm {
  std::size_t joint = 0;  ///< index of the joint
  int coordinate = 0;     ///< coordinate of the joint
  double ratio = 1.0;
};
using CoupledTerms = std::array<CoupledTerm, 2>;

/// Returns the lead of a screw [m/rad].
double lead(const Joint& screw);

/// Sets value and rate of the coupling from the coordinates of the joints.
void read_coupling(const CoupledTerms& terms, const List<JointData>& states,
                   CouplingState* coupling);

/// Adds the generalized force of a coupling to the efforts of its coordinates [N or N m], after the
/// joints have theirs.
void add_coupled_effort(const CoupledTerms& terms, double effort, List<JointData>* states);

}  // namespace constraint_sim::engine
