#include "engine/islands/continuous_collision.h"

#include <algorithm>
#include <cmath>

#include "engine/islands/method_choice.h"
#include "engine/islands/motion_bounds.h"
#include "engine/islands/swept_hits.h"
#include "engine/math/numbers.h"
#include "engine/model/impulse_method.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr int kMostLegs = 1000;  // parts of a step
// Poses that a step tries towards hits, for each near pair: a cylinder costs 40 µs a pose.
constexpr std::size_t kMostAdvancesOfPair = 4000;

/// Sum of the largest displacements of two bodies [m].
double moved_of(const StepContext& step, const State& state, const Broadphase::Pair& pair,
                double duration) {
  const int a = pair.first, b = pair.second;
  return max_point_displacement(step, state.states[a], a, duration) +
         max_point_displacement(step, state.states[b], b, duration);
}

/// Whether two bodies can meet within a duration, whatever they bounce off.
bool may_meet(const StepContext& step, const State& state, const Broadphase::Pair& pair,
              double duration) {
  const int a = pair.first, b = pair.second;
  return separation_of(step.model, state, pair).gap <=
         max_distance(step, state.states[a], a, duration) +
             max_distance(step, state.states[b], b, duration);
}

/// Whether forces led one of two bodies farther than assumed, so that the step is repeated.
bool is_forced(const StepContext& step, const Broadphase::Pair& pair) {
  return step.assumed.of(pair.first) > 0.0 || step.assumed.of(pair.second) > 0.0;
}

/// Time from the start of the step by which events have advanced a body [s].
double found_of(const StepContext& step, const IslandLists& lists, int body) {
  return lists.island_parts[step.topology.island_of(to_index(body))].found.time;
}

/// Whether one of two bodies is dynamic and follows a curve, by a joint or by forces.
bool is_led(const StepContext& step, const IslandLists& lists, const Broadphase::Pair& pair) {
  const auto has_joints = [&](int body) {
    return step.model.is_movable(to_index(body)) &&
           !lists.island_parts[step.topology.island_of(body)].members.joints.empty();
  };
  return has_joints(pair.first) || has_joints(pair.second) || is_forced(step, pair);
}

/// Time within which a touching pair overlaps by no more than contact rows can hold, whichever
/// corner turns towards the other body [s]; 0 for a pair about to hit.
double time_to_watch(const StepContext& step, const State& state, const IslandLists& lists,
                     const TouchingPair& pair) {
  const Model& model = step.model;
  if (pair.manifold.count == 0 || is_forced(step, pair.shapes())) return 0.0;
  if (is_led(step, lists, pair.shapes())) return kInfinity;  // joints hold it back
  const BodyState& a = state.states[pair.a];
  const BodyState& b = state.states[pair.b];
  const Body& body_a = model.bodies[pair.a];
  const Body& body_b = model.bodies[pair.b];
  const double far = (a.position - b.position).norm();
  const double closing =
      std::max(0.0, -pair.manifold.normal.dot(a.linear_velocity - b.linear_velocity)) +
      a.angular_velocity.norm() * swing_radius(body_a, far) +
      b.angular_velocity.norm() * swing_radius(body_b, far);
  return kFastShare * thinner_of(model, pair.shapes()) / closing;
}

/// Whether two bodies that touch would move into each other as far as fast bodies do.
bool is_hit(const Model& model, const State& state, const TouchingPair& pair, double duration) {
  const BodyState& a = state.states[pair.a];
  const BodyState& b = state.states[pair.b];
  double closing = 0.0;
  for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
    const Vector3d& p = pair.manifold.points[k].position;
    const Vector3d v = a.linear_velocity + a.angular_velocity.cross(p - a.position) -
                       b.linear_velocity - b.angular_velocity.cross(p - b.position);
    closing = std::max(closing, -v.dot(pair.manifold.normal));
  }
  return closing * duration > kFastShare * thinner_of(model, pair.shapes());
}

/// Time for which a group with joints can go on so that no fast pair moves by more than its gap, or
/// by kFastShare of the thinner body: these distances are `allowed` [m].
double time_on_joints(const StepContext& step, const State& state,
                      const List<Broadphase::Pair>& near, double left, List<double>* allowed) {
  const Model& model = step.model;
  double longest = left;
  for (const Broadphase::Pair& pair : near) {
    double& limit = allowed->emplace_back(kFastShare * thinner_of(model, pair));
    if (!is_fast(step, state, pair, longest)) continue;
    limit = std::max(limit, separation_of(model, state, pair).gap);
    longest = std::min(longest, limit / moved_of(step, state, pair, longest) * longest);
  }
  return longest;
}

/// Whether a pair without contact has moved by more than twice its entry of `allowed`, driven
/// by joints.
bool has_outrun(const StepContext& step, const State& state, const List<Broadphase::Pair>& near,
                const List<double>& allowed, double duration) {
  for (std::size_t k = 0; k < allowed.size(); ++k) {
    if (moved_of(step, state, near[k], duration) > 2.0 * allowed[k] &&
        find_contact(state.touching, near[k]) == nullptr)
      return true;
  }
  return false;
}

/// Whether a divided step has used up its parts, or the poses that it may try.
bool is_used_up(int leg, int advances, const List<Broadphase::Pair>& near) {
  return leg == kMostLegs ||
         to_index(advances) >= kMostAdvancesOfPair * std::max<std::size_t>(near.size(), 1);
}

/// Time for which a group without joints can go on until the next hit [s], but at least
/// kInstantDuration. Adds the poses tried to `advances`.
double time_without_hit(const StepContext& step, const State& state, const IslandLists& lists,
                        const List<int>& bodies, const List<Broadphase::Pair>& near, double left,
                        int* advances) {
  const Model& model = step.model;
  double duration = left;
  for (const int body : bodies)
    if (swing_radius(model.bodies[body]) > 0.0)
      duration = std::min(duration, kMostSweptTurn / state.states[body].angular_velocity.norm());
  for (const TouchingPair& pair : state.touching)
    duration = std::min(duration, time_to_watch(step, state, lists, pair));
  for (const Broadphase::Pair& pair : near)
    if (is_fast(step, state, pair, duration) && find_contact(state.touching, pair) == nullptr)
      duration = std::max(kInstantDuration * model.options.time_step,
                          time_of_hit(step, state, pair, duration, advances).value_or(duration));
  return duration;
}

/// Finds the contacts of the group, and the contacts about to touch. True where one of them is a
/// hit.
bool collide_group(const Model& model, const List<Broadphase::Pair>& near, double left,
                   State* state) {
  const List<TouchingPair> before = std::move(state->touching);
  state->touching.clear();
  bool any_hit = false;
  for (const Broadphase::Pair& ends : near) {
    const double thinner = thinner_of(model, ends);
    const Manifold manifold =
        collide(model, *state, ends, std::isfinite(thinner) ? 4.0 * kNearShare * thinner : 0.0);
    if (manifold.count == 0) continue;
    TouchingPair& pair = state->touching.emplace_back(new_contact(model, ends));
    pair.manifold = manifold;
    const TouchingPair* known = model.options.warm_starting ? find_contact(before, ends) : nullptr;
    for (std::size_t k = 0; k < to_index(manifold.count); ++k)
      pair.impulses[k] = known != nullptr ? known->impulse_of(manifold.points[k].feature)
                                          : Vector3d::Zero().eval();
    any_hit = any_hit || is_hit(model, *state, pair, left);
  }
  return any_hit;
}

}  // namespace

void ContinuousCollision::set_shapes(const Model& model) {
  fast_bodies_.clear();
  jointed_pairs_.clear();
  thinnest_ = kInfinity;
  for (std::size_t i = 1; i < model.bodies.size(); ++i)
    if (may_touch(model.bodies[i]))
      thinnest_ = std::min(thinnest_, thickness(model.bodies[i].shape));
}

void ContinuousCollision::find_fast_bodies(const StepContext& step, const State& state,
                                           const List<int>& moving_shapes) {
  const Model& model = step.model;
  const double h = model.options.time_step;
  const double speed = fast_share(model.options) * thinnest_ / h - h * model.options.gravity.norm();
  fast_square_ = speed > 0.0 ? speed * speed : -1.0;
  fast_bodies_.clear();
  jointed_pairs_.clear();
  for (const int body : moving_shapes)
    if (is_fast_body(step, state, body)) fast_bodies_.push_back(body);
}

bool ContinuousCollision::is_fast_body(const StepContext& step, const State& state,
                                       int body) const {
  const BodyState& now = state.states[body];
  if (now.linear_velocity.squaredNorm() > fast_square_) return true;
  return (!now.angular_velocity.isZero(0.0) || step.assumed.has_longer_paths()) &&
         max_point_displacement(step, now, body, step.model.options.time_step) >
             fast_share(step.model.options) * thinnest_;
}

void ContinuousCollision::find_hits(const StepContext& step, const List<Broadphase::Pair>& near,
                                    const IslandLists& lists, State* state) {
  const Model& model = step.model;
  const double h = model.options.time_step;
  list_jointed_pairs(step, near, *state, lists);
  // Whether a pair may hit within the step. may_meet() drops pairs that are near only by the
  // bounds that event-driven groups widen.
  const auto is_open = [&](const Broadphase::Pair& pair) {
    return !is_led(step, lists, pair) && is_fast(step, *state, pair, h) &&
           find_contact(state->touching, pair) == nullptr &&
           !step.topology.is_unpaired(pair.bodies()) &&
           (!(follows_contacts(model.options) || controls_contacts(model.options)) ||
            may_meet(step, *state, pair, h));
  };
  List<bool> hits_something(model.bodies.size());
  const auto mark = [&](const std::pair<int, int>& bodies) {
    bool is_new = false;
    for (const int body : {bodies.first, bodies.second}) {
      if (!model.is_movable(to_index(body)) || hits_something[body]) continue;
      hits_something[body] = is_new = true;
    }
    return is_new;
  };
  bool any = false;
  for (const Broadphase::Pair& pair : near) {
    if (!is_open(pair) || !time_of_hit(step, *state, pair, h)) continue;
    any = true;
    mark(pair.bodies());
  }
  if (controls_contacts(model.options)) {  // all that contacts and hits may set in motion
    for (const TouchingPair& pair : state->touching) any = mark(pair.ends()) || any;
    bool is_growing = any;
    while (is_growing) {
      is_growing = false;
      for (const Broadphase::Pair& pair : near)
        if ((hits_something[pair.first] || hits_something[pair.second]) && is_open(pair))
          is_growing = mark(pair.bodies()) || is_growing;
    }
  }
  if (!any) return;
  List<TouchingPair> found;
  for (const Broadphase::Pair& pair : near) {
    if (!hits_something[pair.first] && !hits_something[pair.second]) continue;
    if (!is_open(pair)) continue;
    found.push_back(new_contact(model, pair));
  }
  state->touching.insert(state->touching.end(), found.begin(), found.end());
  std::sort(state->touching.begin(), state->touching.end(), TouchingPair::in_order);
}

void ContinuousCollision::list_jointed_pairs(const StepContext& step,
                                             const List<Broadphase::Pair>& near, const State& state,
                                             const IslandLists& lists) {
  const Model& model = step.model;
  const double h = model.options.time_step;
  jointed_pairs_.clear();
  for (const Broadphase::Pair& pair : near) {
    if (!is_led(step, lists, pair) || !is_fast(step, state, pair, h) ||
        step.topology.is_unpaired(pair.bodies()) || find_contact(state.touching, pair) != nullptr ||
        !may_meet(step, state, pair, h))
      continue;
    jointed_pairs_.push_back(pair);
  }
}

List<int> ContinuousCollision::find_passing(const StepContext& step, const State& state,
                                            const Rollback& rollback,
                                            const IslandLists& lists) const {
  const auto is_integrated = [&](int island) {
    return island < 0 || (!uses_impulses(lists.islands[island].method) &&
                          lists.islands[island].why != MethodReason::kFewContacts);
  };
  List<int> caught;
  const auto is_caught = [&](int island) {
    return std::find(caught.begin(), caught.end(), island) != caught.end();
  };
  const auto catch_pair = [&](int a, int b) {
    bool is_new = false;
    for (const int island : {a, b}) {
      if (island < 0 || !is_integrated(island) || is_caught(island)) continue;
      caught.push_back(island);
      is_new = true;
    }
    return is_new;
  };
  const auto islands_of = [&](const Broadphase::Pair& pair) {
    return std::pair(step.topology.island_of(pair.first), step.topology.island_of(pair.second));
  };
  for (const Broadphase::Pair& pair : jointed_pairs_) {
    const auto [a, b] = islands_of(pair);
    if (is_integrated(a) && is_integrated(b) && passes(step, state, rollback, pair))
      catch_pair(a, b);
  }
  bool is_growing = controls_contacts(step.model.options);
  while (is_growing) {
    is_growing = false;
    for (const Broadphase::Pair& pair : jointed_pairs_) {
      const auto [a, b] = islands_of(pair);
      const bool is_mixed = !is_integrated(a) || !is_integrated(b) || is_caught(a) || is_caught(b);
      if (is_mixed && catch_pair(a, b)) is_growing = true;
    }
  }
  std::sort(caught.begin(), caught.end());
  return caught;
}

void ContinuousCollision::add_jointed_pairs(const StepContext& step, const IslandLists& lists,
                                            State* state) const {
  const Model& model = step.model;
  const auto is_by_impulses = [&](int body) {
    return !model.is_movable(to_index(body)) ||
           uses_impulses(lists.islands[step.topology.island_of(body)].method);
  };
  for (const Broadphase::Pair& pair : jointed_pairs_) {
    if (!is_by_impulses(pair.first) || !is_by_impulses(pair.second)) continue;
    state->touching.push_back(new_contact(model, pair));
  }
  std::sort(state->touching.begin(), state->touching.end(), TouchingPair::in_order);
}

bool ContinuousCollision::divide(const StepContext& step, const IslandLists& lists,
                                 const List<int>& bodies, const List<int>& joints, State* state) {
  const Model& model = step.model;
  const double h = model.options.time_step;
  groups_.clear();
  others_ = ImpulseGroup{};
  group_of_.assign(model.bodies.size(), -1);
  for (const int body : bodies) {
    const double found = found_of(step, lists, body);
    if (found == 0.0) continue;
    const auto same = std::find_if(groups_.begin(), groups_.end(),
                                   [&](const Group& group) { return group.done == found; });
    group_of_[body] = static_cast<int>(same - groups_.begin());
    if (same == groups_.end()) groups_.push_back({{}, found});
  }
  const int of_fast = static_cast<int>(groups_.size());
  bool spreads = false;
  const auto join = [&](int body) {
    if (!model.is_movable(to_index(body)) || group_of_[body] >= 0) return;
    spreads = true;
    for (const int other : lists.island_parts[step.topology.island_of(body)].members.bodies)
      group_of_[other] = of_fast;
  };
  for (const TouchingPair& pair : state->touching) {
    if (time_to_watch(step, *state, lists, pair) >= h) continue;
    join(pair.a);
    join(pair.b);
  }
  if (spreads) groups_.emplace_back();
  while (spreads) {
    spreads = false;
    for (const TouchingPair& pair : state->touching) {
      if (group_of_[pair.a] == of_fast) join(pair.b);
      if (group_of_[pair.b] == of_fast) join(pair.a);
    }
  }
  const auto members_of = [&](int body) -> ImpulseGroup& {
    return group_of_[body] >= 0 ? groups_[group_of_[body]].members : others_;
  };
  for (const int body : bodies) members_of(body).bodies.push_back(body);
  for (const int j : joints) {
    const auto [a, b] = step.topology.ends(j);
    members_of(static_cast<int>(model.is_movable(a) ? a : b)).joints.push_back(j);
  }
  return is_divided();
}

HitReport ContinuousCollision::advance(const StepContext& step, const IslandLists& lists,
                                       const AwakeSets& awake, const List<int>& moving_shapes,
                                       const List<ActingWrench>& wrenches, Broadphase* broadphase,
                                       SequentialImpulses* method, State* state) {
  hits_.clear();
  HitReport report;
  for (const Group& group : groups_) {
    const HitReport of_group = advance_group(step, lists, awake, moving_shapes, wrenches, group,
                                             broadphase, method, state);
    add_impulses(of_group.impulses, &report.impulses);
    report.hits += of_group.hits;
  }
  return report;
}

bool ContinuousCollision::has_met(const Broadphase::Pair& pair) const {
  return is_divided() && find_contact(hits_, pair) != nullptr;
}

std::uint32_t ContinuousCollision::return_contacts(State* state) const {
  std::uint32_t points = 0;
  for (const TouchingPair& pair : hits_) points += static_cast<std::uint32_t>(pair.manifold.count);
  state->touching.insert(state->touching.end(), hits_.begin(), hits_.end());
  std::sort(state->touching.begin(), state->touching.end(), TouchingPair::in_order);
  return points;
}

// Advances a group to the end of the step, and adds its contacts to hits_.
HitReport ContinuousCollision::advance_group(const StepContext& step, const IslandLists& lists,
                                             const AwakeSets& awake, const List<int>& moving_shapes,
                                             const List<ActingWrench>& wrenches, const Group& group,
                                             Broadphase* broadphase, SequentialImpulses* method,
                                             State* state) {
  const Model& model = step.model;
  HitReport report;
  divided_.begin(step, group.members);
  bool has_missed_any = false;
  List<TouchingPair> hits, of_others;
  const auto is_of_group = [&](const TouchingPair& pair) {
    return divided_.contains(pair.a) || divided_.contains(pair.b);
  };
  std::stable_partition(state->touching.begin(), state->touching.end(), is_of_group);
  const auto others = std::find_if_not(state->touching.begin(), state->touching.end(), is_of_group);
  of_others.assign(others, state->touching.end());
  state->touching.erase(others, state->touching.end());
  const bool is_found = group.done > 0.0;
  if (is_found) hits = state->touching;
  const bool is_on_joints =
      (is_found && !group.members.joints.empty()) ||
      std::any_of(state->touching.begin(), state->touching.end(), [&](const TouchingPair& pair) {
        return is_forced(step, pair.shapes()) ||
               (pair.manifold.count == 0 && is_led(step, lists, pair.shapes()));
      });

  if (is_on_joints) divided_.begin_joint_sums();
  const double h = model.options.time_step;
  const ContactStep contacts = contact_step(model.options, h);
  const List<BodyState> at_start = state->states;  // kinematic bodies are moved from here
  bool was_hit = false;
  double done = group.done;
  if (is_on_joints && is_found) divided_.sum_joints(model, done, state);
  int advances = 0;
  List<double> allowed;
  for (int leg = 0; done < h && !is_set(step.stop); ++leg) {
    for (const int body : awake.kinematic)
      state->states[body] = moved(at_start[body], MassProperties{}, Vector3d::Zero(), done);
    const double left = h - done;
    const List<Broadphase::Pair> near =
        divided_.find_pairs(step, *state, moving_shapes, left, broadphase, &has_missed_any);
    allowed.clear();
    const bool is_any_hit = collide_group(model, near, left, state);
    double duration = left;
    if ((report.hits == kMostHits && !is_on_joints) || is_used_up(leg, advances, near)) {
      has_missed_any = true;
    } else if (is_on_joints) {
      report.hits += is_any_hit && !was_hit ? 1 : 0;  // velocities left by sweeps go on closing
      was_hit = is_any_hit;
      duration = std::max(kInstantDuration * h, time_on_joints(step, *state, near, left, &allowed));
    } else if (is_any_hit) {
      ++report.hits;
      duration = std::min(left, kInstantDuration * h);
    } else {
      duration =
          time_without_hit(step, *state, lists, divided_.group().bodies, near, left, &advances);
    }
    const bool is_last = duration >= left;
    if (is_last) duration = left;
    add_impulses(divided_.advance(step, wrenches, done, duration, contacts, ImpulseStepKind::kWhole,
                                  method, state),
                 &report.impulses);
    divided_.sum_joints(model, duration, state);
    if (!are_in_range(*state, divided_.group().bodies)) break;  // the step fails at its end
    has_missed_any = has_missed_any || has_outrun(step, *state, near, allowed, duration);
    add_contacts(state->touching, &hits);
    done = is_last ? h : done + duration;
  }
  for (const int body : awake.kinematic) state->states[body] = at_start[body];
  divided_.finish_joints(step, state);
  for (TouchingPair& pair : hits)
    for (Manifold::Point& point : pair.manifold.points) point.depth = std::max(point.depth, 0.0);
  state->touching = std::move(of_others);
  hits_.insert(hits_.end(), hits.begin(), hits.end());
  std::sort(hits_.begin(), hits_.end(), TouchingPair::in_order);
  if (has_missed_any) note_missed_hits(divided_.group().bodies.front());
  return report;
}

}  // namespace constraint_sim::engine
