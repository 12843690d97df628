#include "engine/islands/unresolved_bodies.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/constraints/joint_kinds.h"
#include "engine/methods/energy_momentum/energy_momentum.h"

namespace constraint_sim::engine {
namespace {

/// Largest spin of a body at both ends of a step [rad/s].
double largest_spin(const State& state, const Rollback& rollback, int body) {
  return std::sqrt(std::max(state.states[body].angular_velocity.squaredNorm(),
                            rollback.states()[body].angular_velocity.squaredNorm()));
}

/// Largest angular speed that a joint's motors and kinematic bodies prescribe [rad/s].
double prescribed_spin(const Model& model, const State& state, std::size_t j) {
  const Joint& joint = model.joints[j];
  const JointForms& kind = forms(joint.kind);
  double spin = 0.0;
  for (int i = 0; i < kind.coordinates; ++i) {
    const auto& motor = joint.coordinates[to_index(i)].motor;
    if (kind.coordinate[to_index(i)].is_angle && motor && motor->is_rigid())
      spin = std::max(spin, std::abs(state.joint_states[j].coordinates[to_index(i)].bias) +
                                std::abs(motor->amplitude));
  }
  for (const BodyId end : {joint.body_a, joint.body_b}) {
    const std::size_t body = model.index(end);
    if (model.bodies[body].type == BodyType::kKinematic)
      spin = std::max(spin, state.states[body].angular_velocity.norm());
  }
  return spin;
}

}  // namespace

std::uint32_t find_spinning(const Model& model, const State& state, const Rollback& rollback,
                            const IslandMembers& members, List<std::size_t>* bodies) {
  if (members.joints.empty()) return 0;
  std::uint32_t count = 0;
  for (const int body : members.bodies) {
    if (!model.masses[body].can_turn() ||
        model.options.time_step * largest_spin(state, rollback, body) <= EnergyMomentum::kResolved)
      continue;
    ++count;
    if (bodies != nullptr) bodies->push_back(to_index(body));
  }
  return count;
}

std::uint32_t find_unresolved(const Model& model, const State& state, const Rollback& rollback,
                              const IslandMembers& members, const IslandMotion& motion,
                              List<std::size_t>* bodies) {
  std::optional<EnergyMomentum> fresh;  // a snapshot has no memory where nothing goes on from it
  const EnergyMomentum* const used = motion.lent<EnergyMomentum>();
  const EnergyMomentum& method = used != nullptr ? *used : fresh.emplace(motion.equations());
  const double h = model.options.time_step;
  const auto turns_too_far = [&](double spin) {
    return method.turn_error(h * spin, model.options.tolerance) > EnergyMomentum::kResolvedTurn;
  };
  List<BodyId> driven;
  for (const int j : members.joints)
    if (turns_too_far(prescribed_spin(model, state, to_index(j))))
      driven.insert(driven.end(), {model.joints[j].body_a, model.joints[j].body_b});
  const List<int>& held = motion.equations().bodies();
  std::uint32_t count = 0;
  for (std::size_t k = 0; k < held.size(); ++k) {
    const int body = held[k];
    const bool turns =
        model.masses[body].can_turn() &&
        (turns_too_far(largest_spin(state, rollback, body)) ||
         std::find(driven.begin(), driven.end(), model.body_ids[body]) != driven.end());
    if (!turns && h * method.frequency_of(k) <= EnergyMomentum::kResolved) continue;
    ++count;
    if (bodies != nullptr) bodies->push_back(to_index(body));
  }
  return count;
}

}  // namespace constraint_sim::engine
