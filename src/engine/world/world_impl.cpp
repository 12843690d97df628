#include "engine/world/world_impl.h"

#include <algorithm>
#include <cmath>
#include <memory>

namespace constraint_sim::engine {
namespace {

/// Clears the forces of a joint that does not act.
void release(JointState* state) {
  state->force = state->bias = 0.0;
  state->saturated = false;
  for (CoordinateState& coordinate : state->coordinates) coordinate.effort = coordinate.bias = 0.0;
}

}  // namespace

// Rebuilds everything that follows from bodies, joints and options: once after an edit, before the
// first stage of a step.
void World::Impl::rebuild_topology() {
  edited = false;
  seen.reset();
  model_mark = std::make_shared<const char>();

  topology.link_joints(*this, joint_states);
  for (std::size_t j = 0; j < joints.size(); ++j)
    if (!acts(joints[j], joint_states[j])) release(&joint_states[j]);

  const auto is_gone = [this](const TouchingPair& pair) { return !is_known(pair); };
  for (List<TouchingPair>* pairs : {&touching, &resting}) {
    pairs->erase(std::remove_if(pairs->begin(), pairs->end(), is_gone), pairs->end());
    for (TouchingPair& pair : *pairs) {
      pair.a = body_index[pair.id_a.value];
      pair.b = body_index[pair.id_b.value];
    }
  }

  smooth_changed = true;
  time_varying_joints.clear();  // until the islands are sorted
  span_ends.clear();

  if (all_edited)
    for (IslandParts& parts : island_parts) static_cast<IslandMemory&>(parts) = parts.after_edit();
  if (topology_edited) {
    topology_edited = false;
    if (all_edited) rotations.clear();
    rotations.resize(bodies.size());
    regroup(*this, group_bodies(*this, joint_states, topology.joint_ends()), [&](std::size_t body) {
      return !all_edited && topology.knows(body) ? topology.island_of(body) : -1;
    });
    topology.set_islands(bodies.size(), island_parts);
    topology.find_loops(*this, joint_states, island_parts);
  }
  take_over_edits();
  compile_islands(*this, *this, topology, this);
  const double quiet = std::ceil(options.sleep_after / options.time_step);
  quiet_steps = quiet < 1e18 ? static_cast<std::uint64_t>(quiet) : 0;
  spread_waking();

  const Energy now = energy();
  largest_kinetic_energy = now.kinetic;
  reference_energy = now.kinetic + now.potential;
  begin_watch();

  states_before.resize(states.size());
  joint_states_before.resize(joint_states.size());
  memory_before.resize(island_parts.size());
}

// Marks the islands of edited bodies, once it is known which islands there are.
void World::Impl::take_over_edits() {
  for (const BodyId id : edited_bodies) {
    if (body_index[id.value] < 0) continue;
    IslandParts& parts = island_parts[topology.island_of(body_index[id.value])];
    if (!parts.is_fresh) static_cast<IslandMemory&>(parts) = parts.after_edit();
    parts.is_fresh = true;
  }
  edited_bodies.clear();
  for (const BodyId id : relinked_bodies)
    if (body_index[id.value] >= 0)
      island_parts[topology.island_of(body_index[id.value])].is_stale = true;
  relinked_bodies.clear();
  if (all_edited)
    restart_all();
  else
    list_fresh();
  all_edited = false;
}

}  // namespace constraint_sim::engine
