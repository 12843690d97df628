#include "engine/world/energy.h"

#include <numeric>

#include "engine/constraints/joint_load.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

Energy energy_of(const Model& model, const State& state) {
  List<int> all_bodies(model.bodies.size());
  List<int> all_joints(model.joints.size());
  std::iota(all_bodies.begin(), all_bodies.end(), 0);
  std::iota(all_joints.begin(), all_joints.end(), 0);
  return energy_of(model, state, all_bodies, all_joints);
}

Energy energy_of(const Model& model, const State& state, const List<int>& of_bodies,
                 const List<int>& of_joints) {
  Energy energy;
  for (const int index : of_bodies) {
    const auto i = static_cast<std::size_t>(index);
    if (!model.is_movable(i)) continue;
    const double mass = 1.0 / model.masses[i].inverse_mass;
    Vector3d v = state.states[i].linear_velocity;
    Vector3d w = state.states[i].angular_velocity;
    if (state.any_corrections) {
      v -= state.corrections[i].head<3>();
      w -= state.corrections[i].tail<3>();
    }
    energy.kinetic += 0.5 * mass * v.squaredNorm();
    energy.potential -=
        model.masses[i].weight_share * mass * model.options.gravity.dot(state.states[i].position);
    if (w.isZero(0.0) || !model.masses[i].can_turn()) continue;
    w = state.states[i].orientation.conjugate() * w;
    energy.kinetic += 0.5 * w.dot(model.masses[i].inertia.cwiseProduct(w));
  }
  for (const int j : of_joints)
    energy.potential += elastic_energy(model.joints[static_cast<std::size_t>(j)],
                                       state.joint_states[static_cast<std::size_t>(j)]);
  return energy;
}

}  // namespace constraint_sim::engine
