// What is told of islands that were integrated, and of their joints: at the end of a step.

#include <algorithm>

#include "engine/islands/contact_group_reports.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
// What islands have kept to themselves, in their order, so that it is the same with any threads;
// true where one of them has another method now.
bool World::Impl::report_islands(const List<int>& smooth) {
  bool any_changed = false;
  report.rows = 0;
  monitors.begin_step();
  for (const int index : smooth) {
    Island& island = islands[index];
    IslandParts& parts = island_parts[index];
    report.projected_energy += parts.projected_energy;
    monitors.add_corrections(parts.correction_work);
    parts.energy.corrections += parts.correction_work;
    report.changes += parts.changes;
    any_stiff = any_stiff || parts.needs_method_choice;
    any_changed = any_changed || parts.changes > 0;
    if (island.method == Method::kSequentialImpulses) continue;  // refused within the step
    if (parts.motion >= 0) {
      const IslandMotion& motion = motions[parts.motion];
      const EquationsOfMotion& equations = motion.equations();
      report.rows += static_cast<std::uint32_t>(equations.rows());
      island.dependent_rows = static_cast<std::uint32_t>(equations.dependent_rows());
      island.events = motion.events();
    }
    if (groups.contains(to_index(index))) {
      island.events = groups.events_of(to_index(index));
      const double driven = groups.driven_work_of(to_index(index));
      monitors.add_drives(driven);
      parts.energy.corrections += driven;
    }
    report.events += island.events;
    if (island.method == Method::kEnergyMomentum && island.why != MethodReason::kInconsistent)
      island.unresolved_bodies = find_unresolved(to_index(index), nullptr);
    report.unresolved_bodies += island.unresolved_bodies;
    report.local_error = std::max(report.local_error, island.local_error);
    report.dependent_rows = std::max(report.dependent_rows, island.dependent_rows);
    report.substeps += island.substeps;
    report.rejected += island.rejected;
    report.iterations += island.iterations;
  }
  return any_changed;
}

// how many there are in an island, and if asked for which bodies
std::uint32_t World::Impl::find_unresolved(std::size_t i, List<std::size_t>* bodies) const {
  if (islands[i].method == Method::kSequentialImpulses)
    return find_spinning(*this, *this, rollback, island_parts[i].members, bodies);
  const IslandMotion& motion = motions[island_parts[i].motion];
  const List<int>& held = motion.equations().bodies();
  std::uint32_t count = 0;
  for (std::size_t k = 0; k < held.size(); ++k) {
    if (options.time_step * motion.gradients().frequency_of(k) <= EnergyMomentum::kResolved)
      continue;
    ++count;
    if (bodies != nullptr) bodies->push_back(to_index(held[k]));
  }
  return count;
}

// Of a joint that couples: where the coordinates are by now, and what it did in a step.
void World::Impl::note_coupling(std::size_t j, double h, double impulse) {
  CouplingState& coupling = joint_states[j].coupling;
  if (couples_joints(joints[j].kind)) read_coupling(terms_of(j), joint_states, &coupling);
  coupling.impulse = impulse;
  coupling.effort = impulse / h;
}

void World::Impl::read_smooth_joints(JointStep step, const MethodPartition& by_method) {
  const bool is_split = span_ends.size() > 2;
  for (std::size_t k = 0; is_split && k < time_varying_joints.size(); ++k) {
    const std::size_t j = to_index(time_varying_joints[k]);
    if (is_integrated(j))
      joint_states[j].bias = (joint_states[j].travel - rollback.joint_states()[j].travel) / step.h;
  }
  for (const int i : by_method.smooth) {
    if (island_parts[i].motion < 0 || groups.contains(to_index(i))) continue;
    IslandMotion& motion = motions[island_parts[i].motion];
    if (const EventDriven* by_events = motion.finish_events(states)) {
      tell_events(*by_events);
      for (std::size_t l = 0; l < by_events->joints().size(); ++l) {
        by_events->write(l, &joint_states[by_events->joints()[l]]);
        read_smooth_joint(to_index(by_events->joints()[l]), step, by_events->impulse(l),
                          by_events->coupled_impulse(l));
      }
      continue;
    }
    const EquationsOfMotion& equations = motion.equations();
    // joints that cannot all be met have shares already
    const bool shares =
        equations.redundant_rows() > 0 && islands[i].why != MethodReason::kInconsistent;
    const LeastNormForces* const shared = shares ? &motion.share_forces(states) : nullptr;
    const bool any_coupling = !equations.coupled_rows().empty();
    const bool any_counted = any_coupling || !equations.soft_coordinates().empty();
    for (std::size_t l = 0; l < equations.joints().size(); ++l) {
      std::array<double, kMaxCoordinates> positions;
      if (any_counted)
        step.counted = equations.count_turns(l, &positions) ? positions.data() : nullptr;
      read_smooth_joint(to_index(equations.joints()[l]), step,
                        shared ? shared->impulse(equations, l) : equations.impulse(l),
                        !any_coupling ? 0.0
                        : shared      ? shared->coupled_impulse(equations, l)
                                      : equations.coupled_impulse(l));
    }
    step.counted = nullptr;
  }
}

void World::Impl::report_contact_groups(const JointStep& step) {
  const std::size_t first = touching.size();
  for (const ContactGroup& group : groups.groups()) {
    if (group.has_failed) continue;
    add_group_events(*this, group, span_ends.back(), &events);
    add_group_contacts(*this, states, group, &touching);
    if (group.spheres != nullptr) continue;
    const ContactEquations& equations = group.events->equations();
    for (std::size_t c = 0; c < equations.coordinates.size(); ++c)
      group.events->write(c, &joint_states[equations.joints[equations.coordinates[c].joint].index]);
    for (const ContactEquations::BodyJoint& joint : equations.joints) {
      if (joint.is_broken) joint_states[joint.index].broken = true;
      read_smooth_joint(to_index(joint.index), step, joint.impulse, 0.0);
    }
  }
  for (std::size_t i = first; i < touching.size(); ++i) {
    const Manifold& manifold = touching[i].manifold;
    report.contacts += static_cast<std::uint32_t>(manifold.count);
    for (std::size_t k = 0; k < to_index(manifold.count); ++k)
      report.max_penetration = std::max(report.max_penetration, manifold.points[k].depth);
  }
  std::sort(touching.begin(), touching.end(), TouchingPair::in_order);
}

void World::Impl::tell_events(const EventDriven& from) {
  for (const EventDriven::Told& told : from.told()) {
    const std::size_t j = to_index(from.joints()[told.joint]);
    events.push_back({told.kind, told.time, joints[j].body_a, joints[j].body_b, joint_ids[j],
                      told.coordinate, told.impulse});
  }
}

// Of a joint that was integrated: where it is by now, and what it did.
void World::Impl::read_smooth_joint(std::size_t j, const JointStep& step, const RowVector& impulse,
                                    double coupled_impulse) {
  const double zeta = courses[j].is_driven() ? courses[j].zeta(step.t + step.h) : 0.0;
  const bool has_coupling = couples(joints[j].kind);
  if (has_coupling) note_coupling(j, step.h, coupled_impulse);
  engine::read_smooth_joint(joints[j], state_a(j), state_b(j), step, impulse, zeta,
                            joint_states[j]);
  if (has_coupling && couples_joints(joints[j].kind))
    add_coupled_effort(terms_of(j), joint_states[j].coupling.effort, &joint_states);
  note_if_broken(j);
}

}  // namespace constraint_sim::engine
