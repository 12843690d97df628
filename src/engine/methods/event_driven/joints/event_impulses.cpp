#include "engine/methods/event_driven/joints/event_impulses.h"

namespace constraint_sim::engine {

void EventImpulses::begin_step(std::size_t joints) {
  sums_.joint.assign(joints, RowVector::Zero());
  sums_.coupled.assign(joints, 0.0);
}

void EventImpulses::add(const OneSidedLaw& law, double impulse) {
  if (law.is_coupling)
    sums_.coupled[law.joint] += impulse;
  else
    sums_.joint[law.joint][law.function] += impulse;
}

void EventImpulses::collect(const EventJoints& joints, const EquationsOfMotion& equations,
                            const List<BodyState>& states) {
  if (equations.delassus().redundant() == 0) return collect_bare(joints, equations);
  if (!least_forces_) least_forces_.emplace(equations);
  least_forces_->share(equations, states);
  for (std::size_t k = 0; k < equations.joints().size(); ++k) {
    const std::size_t l = to_index(equations.joints()[k]);
    sums_.joint[l] += least_forces_->impulse(equations, k);
    if (!equations.coupled_rows().empty() && info(joints[l].kind).couples)
      sums_.coupled[l] += least_forces_->coupled_impulse(equations, k);
  }
}

void EventImpulses::collect_bare(const EventJoints& joints, const EquationsOfMotion& bare) {
  for (std::size_t k = 0; k < bare.joints().size(); ++k) {
    const std::size_t l = to_index(bare.joints()[k]);
    sums_.joint[l] += bare.forces().impulse(bare, k);
    if (!bare.coupled_rows().empty() && info(joints[l].kind).couples)
      sums_.coupled[l] += bare.forces().coupled_impulse(bare, k);
  }
}

}  // namespace constraint_sim::engine
