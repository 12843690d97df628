// What may touch and what does: stages 1 and 2 of a step, and what the step tells of contacts.

#include <algorithm>

#include "engine/collision/narrowphase.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

// ---- 1. broadphase

const List<Broadphase::Pair>& World::Impl::find_pairs() {
  reach.forget_pairs();
  if (moving_shapes.empty()) return broadphase.pairs();
  const StageTimer timer(clock, Stage::kBroadphase, &report.stage_times);
  continuous.find_fast_bodies(*this, *this, moving_shapes);
  if (follows_contacts(options)) reach.begin(*this, *this, moving_shapes);
  find_overlapping();
  if (!follows_contacts(options)) return broadphase.pairs();
  // Each round but the last makes a group larger or faster; longer chains are left as they are.
  constexpr int kMostRounds = 40;
  for (int round = 0;
       reach.grow(*this, topology, *this, *this, sleep.awake(), broadphase.pairs()) &&
       round < kMostRounds;
       ++round)
    find_overlapping();
  return broadphase.pairs();
}

void World::Impl::find_overlapping() {
  proxies.clear();
  const List<int>& fast_bodies = continuous.fast_bodies();
  auto fast = fast_bodies.begin();  // in the order of moving_shapes
  for (const int body : moving_shapes) {
    proxies.push_back(proxy_of(*this, *this, body));
    const bool is_fast_one = fast != fast_bodies.end() && *fast == body;
    if (is_fast_one) {
      widen(max_distance(*this, *this, body, options.time_step), &proxies.back());
      ++fast;
    }
    if (follows_contacts(options)) widen(reach.of(body), &proxies.back());
  }
  report.candidate_pairs = static_cast<std::uint32_t>(broadphase.find_pairs(proxies).size());
  report.broadphase_tests += broadphase.tests();
  if (broadphase.is_full()) throw StepFailed{Failure::kTooManyPairs};
}

// of what may touch: what is to be looked at in every step, and what that may meet
void World::Impl::list_shapes(const List<int>& resting_bodies) {
  const auto has_shape = [&](int body) { return may_touch(bodies[body]); };
  moving_shapes.clear();
  std::copy_if(sleep.awake().bodies.begin(), sleep.awake().bodies.end(),
               std::back_inserter(moving_shapes), has_shape);
  proxies.clear();
  for (const int body : resting_bodies)
    if (has_shape(body)) proxies.push_back(proxy_of(*this, *this, body));
  const auto movable = [&](int body) { return is_movable(to_index(body)); };
  const bool any_movable =
      std::any_of(moving_shapes.begin(), moving_shapes.end(), movable) ||
      std::any_of(proxies.begin(), proxies.end(), [](const Proxy& p) { return p.movable; });
  if (!any_movable || moving_shapes.size() + proxies.size() < 2) moving_shapes.clear();
  if (moving_shapes.empty()) proxies.clear();
  broadphase.set_resting(proxies);
  continuous.set_shapes(*this);
}

// ---- 2. narrowphase

const List<TouchingPair>& World::Impl::find_contacts(const StepContext& step,
                                                     const List<Broadphase::Pair>& near) {
  if (near.empty() && touching.empty() && touching_before.empty() && groups.is_empty())
    return touching;
  collide_pairs(near);
  find_hits(step, near);
  while (wake_touched()) {
    std::swap(touching, touching_before);  // back to the contacts of the step before
    contacts_are_new = false;
    spread_waking();
    save_state();
    collide_pairs(find_pairs());
    find_hits(step, broadphase.pairs());
  }
  groups.find(step, *this, rollback, *this, sleep.awake(), reach, touching_before);
  return touching;
}

void World::Impl::find_hits(const StepContext& step, const List<Broadphase::Pair>& near) {
  if (continuous.fast_bodies().empty()) return;
  continuous.find_hits(step, near, *this, this);
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
    if (points > kMostContacts) throw StepFailed{Failure::kTooManyContacts};

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
