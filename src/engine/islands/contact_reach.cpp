// Who may meet whom within a step, where contacts are followed by events: stage 1 of a step. One
// that is hit gets up to twice as fast as what hits it, so a body may get to twice what it moves by
// itself; where others are there, to what the fastest of these may. Groups grow from pair to pair
// until nobody else is there.

#include <algorithm>
#include <numeric>

#include "engine/collision/narrowphase.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Each but the last one has made a group larger or faster; a chain of many more is left as it is.
constexpr int kMostRounds = 40;

}  // namespace

// Of each body by itself; elastic spheres may be very many, and are as fast as the fastest of them
// from the start.
void World::Impl::begin_reach() {
  reach.assign(bodies.size(), 0.0);
  double of_elastic = 0.0;
  for (const int body : moving_shapes) {
    reach[body] = 2.0 * max_point_displacement(*this, *this, body, options.time_step) + kTouching;
    if (is_elastic_sphere(to_index(body))) of_elastic = std::max(of_elastic, reach[body]);
  }
  for (const int body : moving_shapes)
    if (of_elastic > 0.0 && is_elastic_sphere(to_index(body))) reach[body] = of_elastic;
  own_reach = reach;
}

const List<Broadphase::Pair>& World::Impl::find_pairs() {
  watched_pairs.clear();
  if (moving_shapes.empty()) return broadphase.pairs();
  const StageTimer timer(clock, Stage::kBroadphase, &report.stage_times);
  continuous.find_fast_bodies(*this, *this, moving_shapes);
  if (follows_contacts()) begin_reach();
  find_overlapping();
  if (!follows_contacts()) return broadphase.pairs();
  for (int round = 0; grow_reach() && round < kMostRounds; ++round) find_overlapping();
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
    if (follows_contacts()) widen(reach[body], &proxies.back());
  }
  report.candidate_pairs = static_cast<std::uint32_t>(broadphase.find_pairs(proxies).size());
  report.broadphase_tests += broadphase.tests();
  if (broadphase.is_full()) throw StepFailed{Failure::kTooManyPairs};
}

// Pairs that may touch, and islands that these connect, by the first of them; what is alone has its
// own. True where one of a group may get further than was known.
bool World::Impl::grow_reach() {
  watch_pairs();
  if (watched_pairs.empty()) return false;
  list_group_sizes();
  bool any_grown = false;
  for (const int i : sleep.awake().islands) {
    const GroupSize& size = group_sizes[leader_of[i]];
    if (!size.has_pairs || !(size.is_elastic || size.bodies <= most_bodies_of_group())) continue;
    for (const int body : island_parts[i].members.bodies) {
      if (reach[body] >= size.reach) continue;
      reach[body] = size.reach;
      any_grown = true;
    }
  }
  return any_grown;
}

void World::Impl::watch_pairs() {
  watched_pairs.clear();
  List<int>& leader = leader_of;
  leader.resize(islands.size());
  std::iota(leader.begin(), leader.end(), 0);
  const auto find = [&](int i) {
    while (leader[i] != i) i = leader[i] = leader[leader[i]];
    return i;
  };
  for (const Broadphase::Pair& pair : broadphase.pairs()) {
    const std::optional<double> gap = gap_to_watch(pair);
    if (!gap) continue;
    watched_pairs.push_back({pair, *gap});
    const int a = topology.island_of(pair.first), b = topology.island_of(pair.second);
    if (a >= 0 && b >= 0) leader[std::max(find(a), find(b))] = std::min(find(a), find(b));
  }
  if (watched_pairs.empty()) return;
  for (int i = 0; i < static_cast<int>(islands.size()); ++i) leader[i] = find(i);
}

// How many there are of what could be a group, by its first island: most of what touches in a heap
// is too much, and told without a list of its own.
void World::Impl::list_group_sizes() {
  group_sizes.assign(islands.size(), GroupSize{});
  for (const auto& [pair, gap] : watched_pairs) {
    const int island = std::max(topology.island_of(pair.first), topology.island_of(pair.second));
    GroupSize& size = group_sizes[leader_of[island]];
    size.has_pairs = true;
    for (const int body : {pair.first, pair.second})  // one that moves by itself may hit the others
      if (!is_movable(to_index(body))) size.reach = std::max(size.reach, reach[body]);
    // others are there only for what may be driven at them
    if (gap <= own_reach[pair.first] + own_reach[pair.second])
      size.points +=
          ContactEvents::most_points(bodies[pair.first].shape, bodies[pair.second].shape);
    if (gap >= -ContactEvents::kMostOverlap) continue;
    size.overlaps = true;
    size.is_settled = size.is_settled && is_settled(pair, gap);
  }
  for (const int i : sleep.awake().islands) {
    GroupSize& size = group_sizes[leader_of[i]];
    size.was_handed = size.was_handed || island_parts[i].left_for != MethodReason::kSmooth;
    const List<int>& members = island_parts[i].members.bodies;
    size.bodies += members.size();
    size.is_elastic =
        size.is_elastic && members.size() == 1 && is_elastic_sphere(to_index(members.front()));
    for (const int body : members) size.reach = std::max(size.reach, reach[body]);
  }
}

// what is easily told of it: shapes are within spheres, or on the other side of a plane
double World::Impl::least_gap(std::size_t a, std::size_t b) const {
  if (std::holds_alternative<Plane>(bodies[a].shape)) std::swap(a, b);
  const Vector3d apart = states[a].position - states[b].position;
  if (!std::holds_alternative<Plane>(bodies[b].shape))
    return apart.norm() - extent(bodies[a]) - extent(bodies[b]);
  return apart.dot(states[b].orientation * Vector3d::UnitZ()) - extent(bodies[a]);
}

// the gap of a pair that may touch within the step
std::optional<double> World::Impl::gap_to_watch(const Broadphase::Pair& pair) const {
  const double most = reach[pair.first] + reach[pair.second];
  if (least_gap(to_index(pair.first), to_index(pair.second)) > most || topology.is_unpaired(pair))
    return std::nullopt;
  const double gap = gap_of(*this, *this, pair);
  if (gap > most) return std::nullopt;
  return gap;
}

// Wakes bodies that may be touched within the step.
void World::Impl::wake_approached() {
  for (const auto& [pair, gap] : watched_pairs) {
    if (!(asleep[pair.first] || asleep[pair.second])) continue;
    sleep.wake(pair, this);
  }
}

}  // namespace constraint_sim::engine
