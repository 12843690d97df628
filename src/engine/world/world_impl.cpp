#include "engine/world/world_impl.h"

#include <algorithm>
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
  spread_waking();

  monitors.begin(*this, *this, topology, this);

  rollback.resize(*this, island_parts.size());
}

// Wakes everything that joints or contacts connect with bodies that are awake.
void World::Impl::spread_waking() { list_resting(sleep.spread(*this, topology, this, this)); }

void World::Impl::list_resting(const RestingSets& resting_sets) {
  pipeline.set_shapes(*this, *this, sleep.awake().bodies, resting_sets.bodies);
  continuous.set_shapes(*this);
  monitors.set_resting(*this, *this, resting_sets, *this);
  set_resting_contacts(resting, options.time_step);
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

// Stage 1: pairs of shapes that may touch within the step.
void World::Impl::find_pairs(const StepContext& step) {
  reach.forget_pairs();
  const List<int>& shapes = pipeline.moving_shapes();
  if (shapes.empty()) return;
  const StageTimer timer(step.clock, Stage::kBroadphase, &report.stage_times);
  continuous.find_fast_bodies(*this, *this, shapes);
  if (!follows_contacts(options))
    return pipeline.find_pairs(*this, *this, continuous.fast_bodies(), nullptr, &report);
  reach.begin(*this, *this, shapes);
  pipeline.find_pairs(*this, *this, continuous.fast_bodies(), &reach, &report);
  // Each round but the last makes a group larger or faster; longer chains are left as they are.
  constexpr int kMostRounds = 40;
  for (int round = 0; reach.grow(*this, topology, *this, *this, sleep.awake(), pipeline.pairs()) &&
                      round < kMostRounds;
       ++round)
    pipeline.find_pairs(*this, *this, continuous.fast_bodies(), &reach, &report);
}

// Stage 2: contacts, and groups of contacts that are event-driven. Wakes everything that is
// touched.
void World::Impl::find_contacts(const StepContext& step) {
  if (pipeline.pairs().empty() && touching.empty() && pipeline.touching_before().empty() &&
      groups.is_empty())
    return;
  pipeline.collide(step, this, &report);
  find_hits(step);
  while (wake_touched()) {
    pipeline.take_back(&touching);
    spread_waking();
    save_state();
    find_pairs(step);
    pipeline.collide(step, this, &report);
    find_hits(step);
  }
  groups.find(step, *this, rollback, *this, sleep.awake(), reach, pipeline.touching_before());
}

void World::Impl::find_hits(const StepContext& step) {
  if (continuous.fast_bodies().empty()) return;
  continuous.find_hits(step, pipeline.pairs(), *this, this);
  for (const Broadphase::Pair& pair : continuous.jointed_pairs()) sleep.wake(pair, this);
}

// Wakes bodies in contact, and bodies that may be touched within the step; true where one slept.
bool World::Impl::wake_touched() {
  for (const TouchingPair& pair : touching) sleep.wake(pair.ends(), this);
  if (!sleep.is_stale() && follows_contacts(options))
    for (const auto& [pair, gap] : reach.watched_pairs())
      if (asleep[pair.first] || asleep[pair.second]) sleep.wake(pair, this);
  return sleep.is_stale();
}

}  // namespace constraint_sim::engine
