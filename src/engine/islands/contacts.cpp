// What may touch and what does: stages 1 and 2 of a step, and what the step tells of contacts.

#include <algorithm>

#include "engine/collision/narrowphase.h"
#include "engine/math/list.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

// ---- 1. broadphase

Proxy World::Impl::proxy(int body) const {
  const auto i = to_index(body);
  const PlacedShape placed(bodies[i], states[i]);
  return {bounds(placed.shape(), placed.state()), body, is_movable(i)};
}

// ---- 2. narrowphase

const List<TouchingPair>& World::Impl::find_contacts(const List<Broadphase::Pair>& near) {
  if (near.empty() && touching.empty() && touching_before.empty() && contact_groups.empty())
    return touching;
  collide_pairs(near);
  if (!fast_bodies.empty()) find_hits(near);
  while (wake_touched() || (follows_contacts() && wake_approached())) {
    std::swap(touching, touching_before);  // back to the contacts of the step before
    contacts_are_new = false;
    spread_waking();
    save_state();
    collide_pairs(find_pairs());
    if (!fast_bodies.empty()) find_hits(broadphase.pairs());
  }
  find_contact_groups(broadphase.pairs());
  return touching;
}

void World::Impl::collide_pairs(const List<Broadphase::Pair>& near) {
  std::swap(touching, touching_before);
  contacts_are_new = true;
  touching.clear();
  if (near.empty()) return;
  const StageTimer timer(clock, Stage::kNarrowphase, &report.stage_times);
  std::size_t points = 0;
  auto before = touching_before.begin();  // both lists are sorted, so one pass matches them
  for (const Broadphase::Pair& ends : near) {
    if (topology.is_unpaired(ends)) continue;
    if (is_set(stop)) return;
    const auto a = to_index(ends.first);
    const auto b = to_index(ends.second);
    const Manifold manifold =
        collide(PlacedShape(bodies[a], states[a]), PlacedShape(bodies[b], states[b]));
    if (manifold.count == 0) continue;
    points += to_index(manifold.count);
    if (points > kMostContacts) fail(Failure::kTooManyContacts);

    TouchingPair& pair = touching.emplace_back();
    pair.a = ends.first;
    pair.b = ends.second;
    pair.id_a = body_ids[a];
    pair.id_b = body_ids[b];
    pair.manifold = manifold;
    while (before != touching_before.end() && before->ends() < ends) ++before;
    const bool known =
        options.warm_starting && before != touching_before.end() && before->ends() == ends;
    for (std::size_t k = 0; k < to_index(manifold.count); ++k)
      pair.impulses[k] =
          known ? before->impulse_of(manifold.points[k].feature) : Vector3d(Vector3d::Zero());
  }
}

Vector3d TouchingPair::impulse_of(std::uint32_t feature) const {
  for (std::size_t k = 0; k < to_index(manifold.count); ++k)
    if (manifold.points[k].feature == feature) return impulses[k];
  return Vector3d::Zero();
}

// ---- after the step

void World::Impl::tell_contacts() {
  contacts.resize(resting_contacts);
  for (const TouchingPair& pair : touching) add_contacts(pair);
}

void World::Impl::add_contacts(const TouchingPair& pair) {
  for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
    const Manifold::Point& point = pair.manifold.points[k];
    const Vector3d force = pair.impulses[k] / options.time_step;
    const double normal_force = pair.impulses[k].dot(pair.manifold.normal) / options.time_step;
    contacts.push_back({pair.id_a, pair.id_b, point.position, pair.manifold.normal, point.depth,
                        normal_force, force, pair.contact_states[k]});
  }
}

}  // namespace constraint_sim::engine
