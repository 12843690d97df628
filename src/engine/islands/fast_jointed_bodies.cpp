// Fast bodies on joints, which lead them along curves. What is integrated has its step, and where
// it would have passed through something the step is taken again by impulses. These divide the
// step of a group with joints so that nothing moves by more than its gap, or by a quarter of the
// thinner shape; there joints and contacts are solved together as in any step.

#include <algorithm>
#include <cmath>

#include "engine/collision/narrowphase.h"
#include "engine/islands/fast_bodies.h"
#include "engine/math/list.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kMostPlaces = 20000;  // along a path

/// Where a body is within a step, by where it is at both ends and how it moves there: on a cubic,
/// and turning evenly. At a share s of the step.
struct Path {
  Vector3d x0, x1, m0, m1;
  Quaterniond q0;
  Vector3d turn, rest;  // what it turns by [rad], and what that is off by

  Path(const BodyState& from, const BodyState& to, double h)
      : x0(from.position),
        x1(to.position),
        m0(h * from.linear_velocity),
        m1(h * to.linear_velocity),
        q0(from.orientation),
        turn(0.5 * h * (from.angular_velocity + to.angular_velocity)) {
    rest = rotation_vector(to.orientation * (rotation(turn) * q0).conjugate());
  }
  BodyState at(double s) const {
    const double t = 1.0 - s;
    BodyState state;
    state.position = t * t * (1.0 + 2.0 * s) * x0 + s * t * t * m0 + s * s * (3.0 - 2.0 * s) * x1 -
                     s * s * t * m1;
    state.orientation = rotation(s * rest) * (rotation(s * turn) * q0);
    return state;
  }
  // what its centre moves by at most for a unit of s, and what it turns by
  double way() const {
    return std::max({m0.norm(), m1.norm(), (3.0 * (x1 - x0) - m0 - m1).norm()});
  }
  double angle() const { return turn.norm() + rest.norm(); }
};

}  // namespace

bool World::Impl::has_joints(const Broadphase::Pair& pair) const {
  const auto has = [&](int body) {
    return is_movable(to_index(body)) &&
           !island_parts[topology.island_of(body)].members.joints.empty();
  };
  return has(pair.first) || has(pair.second);
}

// those that are fast, and apart; what may be hit is awake
void World::Impl::list_jointed_pairs(const List<Broadphase::Pair>& near) {
  const double h = options.time_step;
  jointed_pairs.clear();
  for (const Broadphase::Pair& pair : near) {
    if (!has_joints(pair) || !is_fast(pair, h) || topology.is_unpaired(pair) || is_touching(pair) ||
        gap_of(pair) > swept(pair.first, h) + swept(pair.second, h))
      continue;
    jointed_pairs.push_back(pair);
    sleep.wake(pair, this);
  }
}

// Whether two that have had their step have met within; not looked at in a step that is to stop.
bool World::Impl::passes(const Broadphase::Pair& pair) const {
  const double h = options.time_step;
  const std::size_t i = to_index(pair.first), j = to_index(pair.second);
  const auto path_of = [&](std::size_t body) {
    if (is_movable(body)) return Path(rollback.states()[body], states[body], h);
    BodyState later = states[body];  // what moves by itself does so at the end of the step
    later.position += h * later.linear_velocity;
    later.orientation = rotation(h * later.angular_velocity) * later.orientation;
    return Path(states[body], later, h);
  };
  const Path of_i = path_of(i), of_j = path_of(j);
  const double far = (of_i.x0 - of_j.x0).norm() + of_i.way() + of_j.way();
  const double bound = of_i.way() + of_j.way() + of_i.angle() * reach_of(bodies[i], far) +
                       of_j.angle() * reach_of(bodies[j], far);
  const double least =
      kFastShare * std::min(thickness(bodies[i].shape), thickness(bodies[j].shape));
  double s = 0.0;
  for (int k = 0; k < kMostPlaces && s < 1.0; ++k) {
    if (is_set(stop)) return false;
    const BodyState at_i = of_i.at(s), at_j = of_j.at(s);
    const PlacedShape shape_i(bodies[i], at_i), shape_j(bodies[j], at_j);
    const double gap =
        separation(shape_i.shape(), shape_i.state(), shape_j.shape(), shape_j.state()).gap;
    if (gap <= 0.0 && s > 0.0) return true;
    if (gap > (1.0 - s) * bound) return false;
    s += std::max(gap, least) / bound;
  }
  return s < 1.0;  // too long a way along each other to be looked at
}

// Islands that were integrated, and would have passed through something: impulses take this step.
void World::Impl::catch_what_passes() {
  const auto is_integrated = [&](int island) {
    return island < 0 || (islands[island].method != Method::kSequentialImpulses &&
                          !is_in_group(to_index(island)));
  };
  List<int> caught;
  for (const Broadphase::Pair& pair : jointed_pairs) {
    const int a = topology.island_of(pair.first), b = topology.island_of(pair.second);
    if (!is_integrated(a) || !is_integrated(b) || !passes(pair)) continue;
    for (const int island : {a, b})
      if (island >= 0) caught.push_back(island);
  }
  std::sort(caught.begin(), caught.end());
  caught.erase(std::unique(caught.begin(), caught.end()), caught.end());
  for (const int i : caught) {
    refuse_island(to_index(i), MethodReason::kContact);
    remember_choice({Method::kSequentialImpulses, MethodReason::kContact}, true, step_count,
                    &island_parts[i]);
  }
}

// Pairs whose islands impulses carry now, as ones about to hit.
void World::Impl::add_jointed_pairs() {
  const auto is_carried = [&](int body) {
    return !is_movable(to_index(body)) ||
           islands[topology.island_of(body)].method == Method::kSequentialImpulses;
  };
  for (const Broadphase::Pair& pair : jointed_pairs) {
    if (!is_carried(pair.first) || !is_carried(pair.second)) continue;
    TouchingPair& hit = touching.emplace_back();
    hit.a = pair.first;
    hit.b = pair.second;
    hit.id_a = body_ids[pair.first];
    hit.id_b = body_ids[pair.second];
  }
  std::sort(touching.begin(), touching.end(),
            [](const TouchingPair& l, const TouchingPair& r) { return l.ends() < r.ends(); });
}

// For how long a group with joints can go on so that no fast pair moves by more than its gap, or by
// what is not fast: these are `ways`.
double World::Impl::time_on_joints(const List<Broadphase::Pair>& near, double left,
                                   List<double>* ways) const {
  double longest = left;
  for (const Broadphase::Pair& pair : near) {
    const std::size_t a = to_index(pair.first), b = to_index(pair.second);
    double& way = ways->emplace_back(
        kFastShare * std::min(thickness(bodies[a].shape), thickness(bodies[b].shape)));
    if (!is_fast(pair, longest)) continue;
    way = std::max(way, gap_of(pair));
    const double moved = travel(pair.first, longest) + travel(pair.second, longest);
    longest = std::min(longest, way / moved * longest);
  }
  return longest;
}

// Whether joints have made a pair that is apart so fast that it moved by twice that and more.
bool World::Impl::has_outrun(const List<Broadphase::Pair>& near, const List<double>& ways,
                             double duration) const {
  for (std::size_t k = 0; k < ways.size(); ++k) {
    const auto [a, b] = near[k];
    if (travel(a, duration) + travel(b, duration) > 2.0 * ways[k] && !is_touching(near[k]))
      return true;
  }
  return false;
}

}  // namespace constraint_sim::engine
