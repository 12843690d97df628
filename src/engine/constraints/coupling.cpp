#include "engine/constraints/coupling.h"

#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

double lead(const Joint& screw) { return screw.pitch / (2.0 * kPi); }

void read_coupling(const CoupledTerms& terms, const List<JointData>& states,
                   CouplingState* coupling) {
  coupling->value = coupling->rate = 0.0;
  for (const CoupledTerm& term : terms) {
    const CoordinateState& coordinate =
        states[term.joint].coordinates[static_cast<std::size_t>(term.coordinate)];
    coupling->value += term.ratio * coordinate.position;
    coupling->rate += term.ratio * coordinate.velocity;
  }
}

void add_coupled_effort(const CoupledTerms& terms, double effort, List<JointData>* states) {
  for (const CoupledTerm& term : terms) {
    JointData& state = (*states)[term.joint];
    state.coordinates[static_cast<std::size_t>(term.coordinate)].effort += term.ratio * effort;
    state.force = state.coordinates[0].effort;
  }
}

}  // namespace constraint_sim::engine
