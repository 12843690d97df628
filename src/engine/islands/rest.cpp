// Islands at rest are left out of every stage until something touches them: before the first stage
// of a step, and after the last.
//
// An island rests when nothing in it has moved for `sleep_after`: to the bit where it is
// integrated, so that the next step would only repeat the last one; by no more than `sleep_speed`
// where impulses hold it, whose rounding never ends. It keeps its state, with velocities of zero,
// and the impulses that held it, so that it makes no difference for how long it slept.

#include <algorithm>
#include <cmath>

#include "engine/islands/fast_bodies.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

constexpr std::uint64_t kReturns = 4;  // times as long awake where contacts are left to impulses

/// Moves what is not kept from one sorted list to another.
template <class Kept>
void move_over(List<TouchingPair>* from, List<TouchingPair>* to, Kept kept) {
  const auto moved = std::stable_partition(from->begin(), from->end(), kept);
  if (moved == from->end()) return;
  to->insert(to->end(), moved, from->end());
  from->erase(moved, from->end());
  std::sort(to->begin(), to->end(), TouchingPair::in_order);
}

}  // namespace

// ---- waking

void World::Impl::wake(std::size_t body) {
  any_waking = any_waking || asleep[body];
  asleep[body] = false;
}

void World::Impl::wake_all() {
  if (!may_sleep) return;
  for (std::size_t i = 0; i < asleep.size(); ++i) wake(i);
  may_sleep = false;
}

// all that touch a body
void World::Impl::wake_around(BodyId id) {
  for (const TouchingPair& pair : resting) {
    if (!is_known(pair)) continue;
    if (pair.id_a == id) wake(index(pair.id_b));
    if (pair.id_b == id) wake(index(pair.id_a));
  }
}

// what a body touches that moves
bool World::Impl::wake_touched() {
  for (const TouchingPair& pair : touching) {
    wake(to_index(pair.a));
    wake(to_index(pair.b));
  }
  return any_waking;
}

// from those awake to all that joints or contacts connect with them
void World::Impl::spread_waking() {
  if (any_waking) {
    List<const List<int>*> groups;
    for (const IslandParts& parts : island_parts) groups.push_back(&parts.members.bodies);
    List<std::pair<int, int>> near;
    for (const TouchingPair& pair : resting) near.push_back(pair.ends());
    spread_waking(groups, near, &asleep);
  }
  any_waking = false;
  move_over(&resting, &touching,
            [&](const TouchingPair& pair) { return asleep[pair.a] || asleep[pair.b]; });
  list_awake();
}

// the same in a list: of islands all or none of the bodies sleep
void World::Impl::spread_waking(const List<const List<int>*>& groups,
                                const List<std::pair<int, int>>& near, List<bool>* sleeps) const {
  const auto wake_other = [&](int body, int other) {
    if (!is_movable(to_index(body)) || (*sleeps)[body] || !(*sleeps)[other]) return false;
    (*sleeps)[other] = false;
    return true;
  };
  for (bool spreads = true; spreads;) {
    spreads = false;
    for (const List<int>* group : groups) {
      for (const int body : *group) spreads = wake_other(group->front(), body) || spreads;
      for (const int body : *group) spreads = wake_other(body, group->front()) || spreads;
    }
    for (const auto& [a, b] : near) {
      spreads = wake_other(a, b) || spreads;
      spreads = wake_other(b, a) || spreads;
    }
  }
}

// ---- falling asleep

void World::Impl::fall_asleep() {
  if (quiet_steps == 0) return;
  bool any_due = false;  // those kept awake by others are asked again now and then
  for (const int i : awake_islands) {
    IslandParts& parts = island_parts[i];
    parts.quiet_for = is_quiet(to_index(i)) ? parts.quiet_for + 1 : 0;
    any_due = any_due || (parts.quiet_for > 0 && parts.quiet_for % quiet_steps == 0);
  }
  if (!any_due || !find_sleep_candidates()) return;

  may_sleep = true;
  for (const int i : sleep_candidates) {
    // what it was to remember for so many steps would depend on how long it sleeps
    static_cast<IslandMemory&>(island_parts[i]) = {};
    for (const int body : island_parts[i].members.bodies) {
      asleep[body] = true;
      states[body].linear_velocity.setZero();
      states[body].angular_velocity.setZero();
      corrections[body].setZero();
    }
  }
  const auto is_awake = [&](int body) { return is_movable(to_index(body)) && !asleep[body]; };
  move_over(&touching, &resting, [&](const TouchingPair& pair) {
    return is_awake(pair.a) || is_awake(pair.b) || !(asleep[pair.a] || asleep[pair.b]);
  });
  list_awake();
  tell_contacts();
}

bool World::Impl::is_quiet(std::size_t island) const {
  // most move faster than any limit
  const std::size_t first = to_index(island_parts[island].members.bodies.front());
  if (states[first].linear_velocity.squaredNorm() > options.sleep_speed * options.sleep_speed)
    return false;
  const bool by_impulses = islands[island].method == Method::kSequentialImpulses ||
                           islands[island].why == MethodReason::kFewContacts;
  const double limit = by_impulses ? options.sleep_speed * options.sleep_speed : 0.0;
  for (const int body : island_parts[island].members.bodies) {
    const BodyState& state = states[body];
    if (state.linear_velocity.squaredNorm() > limit) return false;
    const double radius = masses[body].radius_of_gyration();
    if (radius * radius * state.angular_velocity.squaredNorm() > limit) return false;
    if (!by_impulses || !any_corrections) continue;
    // a load that corrections lift by what it sinks in each step does not rest
    const Twist& correction = corrections[body];
    if (correction.head<3>().squaredNorm() > limit) return false;
    if (radius * radius * correction.tail<3>().squaredNorm() > limit) return false;
  }
  return true;
}

// whether something will move it that its velocities do not show
bool World::Impl::is_driven(std::size_t island) const {
  for (const int index : island_parts[island].members.joints) {
    const std::size_t j = to_index(index);
    if (joint_states[j].closing || is_custom_force(joints[j].kind)) return true;
    bool is_moving = false;
    for (const CoordinateState& coordinate : joint_states[j].coordinates)
      is_moving = is_moving || coordinate.braking > 0.0;  // on its way back
    visit_motors(joints[j], joint_states[j],
                 [&](const Motor& motor, double end) { is_moving |= drives(motor, time() < end); });
    if (is_moving || any_coordinate(joints[j], [](const CoordinateLaw& law) {
          return law.motor && law.motor->force.value_or(0.0) != 0.0;
        }))
      return true;
    for (const std::size_t end : {topology.ends(j).first, topology.ends(j).second})
      if (!is_movable(end) && is_moving_by_itself(end)) return true;
  }
  return std::any_of(wrenches.begin(), wrenches.end(), [&](const Wrench& wrench) {
    return topology.island_of(index(wrench.body)) == static_cast<int>(island);
  });
}

bool World::Impl::is_moving_by_itself(std::size_t body) const {
  return bodies[body].type == BodyType::kKinematic &&
         !(states[body].linear_velocity.isZero(0.0) && states[body].angular_velocity.isZero(0.0));
}

// islands that were quiet for long enough, and touch none but such, nor may within a step
bool World::Impl::find_sleep_candidates() {
  is_sleep_candidate.assign(islands.size(), false);
  for (const int i : awake_islands) {
    const IslandParts& parts = island_parts[i];
    // what is to come back from impulses does so first, for they leave overlaps; but what falls
    // back each time is not kept awake by that for ever
    const bool waits = step_count <= parts.contacts_refused_until;
    const std::uint64_t least = (waits ? kReturns : 1) * quiet_steps;
    is_sleep_candidate[i] = parts.quiet_for >= least && !is_driven(to_index(i));
  }
  const auto keep_awake = [&](int body, int other) {
    if (!is_movable(to_index(body)) || !is_sleep_candidate[topology.island_of(body)]) return false;
    const bool other_moves = is_movable(to_index(other))
                                 ? !is_sleep_candidate[topology.island_of(other)]
                                 : is_moving_by_itself(to_index(other));
    if (other_moves) is_sleep_candidate[topology.island_of(body)] = false;
    return other_moves;
  };
  for (bool spreads = true; spreads;) {
    spreads = false;
    for (const TouchingPair& pair : touching) {
      spreads = keep_awake(pair.a, pair.b) || spreads;
      spreads = keep_awake(pair.b, pair.a) || spreads;
    }
    for (const auto& [pair, gap] : watched_pairs) {  // they would wake at once
      spreads = keep_awake(pair.first, pair.second) || spreads;
      spreads = keep_awake(pair.second, pair.first) || spreads;
    }
  }
  sleep_candidates.clear();
  for (const int i : awake_islands)
    if (is_sleep_candidate[i]) sleep_candidates.push_back(i);
  return !sleep_candidates.empty();
}

// ---- once after somebody woke or fell asleep

// what the stages go through, and what a step reports of all the rest
void World::Impl::list_awake() {
  awake_changed = watch.awake_changed = true;
  resting_report = StepReport{};
  awake_islands.clear();
  for (std::size_t i = 0; i < islands.size(); ++i) {
    if (!asleep[island_parts[i].members.bodies.front()]) {
      awake_islands.push_back(static_cast<int>(i));
      continue;
    }
    Island& island = islands[i];
    island.why = MethodReason::kAtRest;
    island.local_error = 0.0;
    island.substeps = island.rejected = island.iterations = island.unresolved_bodies = 0;
    island_parts[i].quiet_for = 0;
    resting_report.dependent_rows = std::max(resting_report.dependent_rows, island.dependent_rows);
  }
  awake_bodies.clear();
  kinematic.clear();
  List<int> resting_bodies;
  for (std::size_t i = 1; i < bodies.size(); ++i) {
    const bool moves_by_itself = is_moving_by_itself(i);
    if (moves_by_itself) kinematic.push_back(static_cast<int>(i));
    const bool is_awake = moves_by_itself || (is_movable(i) && !asleep[i]);
    (is_awake ? awake_bodies : resting_bodies).push_back(static_cast<int>(i));
  }
  share_attempts();
  awake_joints.clear();
  List<int> resting_joints;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const auto [a, b] = topology.ends(j);
    (asleep[is_movable(a) ? a : b] ? resting_joints : awake_joints).push_back(static_cast<int>(j));
  }
  list_shapes(resting_bodies);

  resting_report.asleep = static_cast<std::uint32_t>(islands.size() - awake_islands.size());
  for (const TouchingPair& pair : resting)
    for (std::size_t k = 0; k < static_cast<std::size_t>(pair.manifold.count); ++k)
      resting_report.max_penetration =
          std::max(resting_report.max_penetration, pair.manifold.points[k].depth);
  find_worst_joint(resting_joints, &resting_report);
  resting_energy = energy(resting_bodies, resting_joints);

  contacts.clear();
  for (const TouchingPair& pair : resting) add_contacts(pair);
  resting_contacts = contacts.size();
}

// of what may touch: what is to be looked at in every step, and what that may meet
void World::Impl::list_shapes(const List<int>& resting_bodies) {
  const auto has_shape = [&](int body) {
    return !bodies[body].no_collision && !std::holds_alternative<Point>(bodies[body].shape);
  };
  moving_shapes.clear();
  std::copy_if(awake_bodies.begin(), awake_bodies.end(), std::back_inserter(moving_shapes),
               has_shape);
  proxies.clear();
  for (const int body : resting_bodies)
    if (has_shape(body)) proxies.push_back(proxy(body));
  const auto movable = [&](int body) { return is_movable(to_index(body)); };
  const bool any_movable =
      std::any_of(moving_shapes.begin(), moving_shapes.end(), movable) ||
      std::any_of(proxies.begin(), proxies.end(), [](const Proxy& p) { return p.movable; });
  if (!any_movable || moving_shapes.size() + proxies.size() < 2) moving_shapes.clear();
  if (moving_shapes.empty()) proxies.clear();
  broadphase.set_resting(proxies);
  thinnest = kInfinity;
  for (std::size_t i = 1; i < bodies.size(); ++i)
    if (has_shape(static_cast<int>(i))) thinnest = std::min(thinnest, thickness(bodies[i].shape));
}

}  // namespace constraint_sim::engine
