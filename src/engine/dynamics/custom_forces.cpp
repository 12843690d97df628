// Forces of custom joint kinds in EquationsOfMotion, which act in addition to all rows.

#include <algorithm>
#include <tuple>

#include "engine/constraints/custom.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

// Adds custom forces to acceleration_ and torque_, as pull_softs() adds forces along coordinates.
void EquationsOfMotion::pull_custom() {
  if (first_.spring == links_.size() && softs_.empty())
    std::copy(inputs_.acceleration().begin(), inputs_.acceleration().end(), acceleration_.begin());
  for (std::size_t l = first_.general; l < first_.spring; ++l) {
    const Link& link = links_[l];
    if (!link.has_custom_force()) continue;
    const std::size_t g = l - first_.general;
    const Jacobian wrench = link.custom->wrench(placed_at_, vectors_[g], motions_[g]);
    acceleration_[link.a] += inverse_mass_[link.a] * wrench.j1;
    acceleration_[link.b] += inverse_mass_[link.b] * wrench.j3;
    if (rotates(link.a)) torque_[link.a] += wrench.j2;
    if (rotates(link.b)) torque_[link.b] += wrench.j4;
  }
}

void EquationsOfMotion::add_custom_loads(double t, const List<BodyState>& states) {
  if (!has_custom_forces_) return;
  List<double> y(size());
  gather_state(states, y.data());
  update_kinematics(t, y.data());
  set_velocities(y.data());
  for (std::size_t l = first_.general; l < first_.spring; ++l) {
    const Link& link = links_[l];
    if (!link.has_custom_force()) continue;
    const std::size_t g = l - first_.general;
    const Jacobian wrench = link.custom->wrench(t, vectors_[g], motions_[g]);
    for (const auto& [point, force, torque] :
         {std::tuple(link.a, wrench.j1, wrench.j2), {link.b, wrench.j3, wrench.j4}}) {
      if (point < bodies_.size()) inputs_.add_load(*this, point, force, torque);
    }
  }
}

}  // namespace constraint_sim::engine
