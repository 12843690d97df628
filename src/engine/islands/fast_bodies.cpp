// Bodies that move so far in a step that they could pass through another one, or through themselves
// into it: they are carried to each hit by conservative advancement (Mirtich 1996), and on from
// there. All that may hit each other within the step, with what is joined to it, is one group; the
// tick of the group is divided at its hits, which happen in no time. What is not in the group takes
// its step as always. Where nothing is fast, a step has one comparison a body.

#include "engine/islands/fast_bodies.h"

#include <algorithm>
#include <cmath>

#include "engine/collision/narrowphase.h"
#include "engine/math/elementary.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kNear = 1e-9;      // of it, within which a hit happens
constexpr double kInstant = 1e-9;   // of a step, that a hit takes
constexpr double kMostTurn = 0.5;   // [rad] of a body in a part of a step
constexpr int kMostAdvances = 100;  // towards one hit
constexpr int kMostLegs = 1000;     // parts of a step

struct Thickness {
  double operator()(const Point&) const { return kInfinity; }
  double operator()(const Sphere& sphere) const { return 2.0 * sphere.radius; }
  double operator()(const Box& box) const { return box.size.minCoeff(); }
  double operator()(const Plane&) const { return kInfinity; }
  double operator()(const Cylinder& cylinder) const {
    return std::min(2.0 * cylinder.radius, cylinder.length);
  }
};

/// How far from the centre of a body its rotation moves a shape [m]. A plane is the same everywhere
/// but where it is met: `distance` away.
struct Reach {
  double distance;
  double operator()(const Point&) const { return 0.0; }
  double operator()(const Sphere&) const { return 0.0; }
  double operator()(const Box& box) const { return 0.5 * box.size.norm(); }
  double operator()(const Plane&) const { return distance; }
  double operator()(const Cylinder& cylinder) const {
    return math::hypot(cylinder.radius, 0.5 * cylinder.length);
  }
};

/// Where a step of impulses of length t leaves a body that nothing but gravity acts on.
BodyState moved(const BodyState& state, const MassProperties& mass, const Vector3d& gravity,
                double t) {
  BodyState later = state;
  later.position += t * (state.linear_velocity + t * gravity);
  advance_orientation(mass, t, &later);
  return later;
}

/// The most that a body may turn by without torque, by its moments, and what the rotation of a step
/// of up to kMostTurn is beyond that of the motion [rad/s].
double fastest_turn(const BodyState& state, const MassProperties& mass) {
  const double w = state.angular_velocity.norm();
  if (!mass.can_turn() || mass.is_isotropic()) return w;
  return 1.1 * w * mass.inertia.maxCoeff() / mass.inertia.minCoeff();
}

/// The contact of a pair in a list that is sorted; null where there is none.
const TouchingPair* find(const List<TouchingPair>& pairs, const std::pair<int, int>& ends) {
  const auto found =
      std::lower_bound(pairs.begin(), pairs.end(), ends,
                       [](const TouchingPair& pair, const std::pair<int, int>& wanted) {
                         return pair.ends() < wanted;
                       });
  return found != pairs.end() && found->ends() == ends ? &*found : nullptr;
}

}  // namespace

double thickness(const Shape& shape) { return std::visit(Thickness{}, shape); }

double reach_of(const Body& body, double distance) {
  const double arm = body.shape_pose ? body.shape_pose->position.norm() : 0.0;
  return std::visit(Reach{distance}, body.shape) + arm;
}

double extent(const Body& body) {
  const auto* sphere = std::get_if<Sphere>(&body.shape);
  return reach_of(body, kInfinity) + (sphere != nullptr ? sphere->radius : 0.0);
}

// ---- who is fast

void World::Impl::find_fast_speed() {
  const double h = options.time_step;
  const double speed = kFastShare * thinnest / h - h * options.gravity.norm();
  fast_square = speed > 0.0 ? speed * speed : -1.0;
}

bool World::Impl::is_fast(int body) const {
  const BodyState& state = states[body];
  if (state.linear_velocity.squaredNorm() > fast_square) return true;
  return !state.angular_velocity.isZero(0.0) &&
         travel(body, options.time_step) > kFastShare * thinnest;
}

// the most that a body's centre moves by
double World::Impl::way(int body, double duration) const {
  const double fall = is_movable(to_index(body)) ? duration * options.gravity.norm() : 0.0;
  return duration * (states[body].linear_velocity.norm() + fall);
}

// the most that a point of a body moves by
double World::Impl::travel(int body, double duration) const {
  const BodyState& state = states[body];
  if (state.angular_velocity.isZero(0.0)) return way(body, duration);
  return way(body, duration) + duration * state.angular_velocity.norm() * reach_of(bodies[body]);
}

// whether two bodies move against each other by more than a share of the thinner one
bool World::Impl::is_fast(const Broadphase::Pair& pair, double duration) const {
  const auto [a, b] = pair;
  const double thinner = std::min(thickness(bodies[a].shape), thickness(bodies[b].shape));
  return travel(a, duration) + travel(b, duration) > kFastShare * thinner;
}

// The same, whatever it bounces off: however fast it turns, it stays within its reach.
double World::Impl::swept(int body, double duration) const {
  return std::min(travel(body, duration), way(body, duration) + reach_of(bodies[body]));
}

// Everywhere that a body gets to in a time.
void World::Impl::sweep(double duration, Proxy* proxy) const {
  const Vector3d margin = Vector3d::Constant(swept(proxy->body, duration));
  proxy->box.min -= margin;
  proxy->box.max += margin;
}

// ---- what they hit

// The first time at which a pair that is apart touches, as far as its velocities say. The plane
// between two shapes keeps them apart as long as they do not close the gap along its normal. None
// in a step that is to stop.
std::optional<double> World::Impl::time_of_hit(const Broadphase::Pair& pair,
                                               double duration) const {
  const std::size_t i = to_index(pair.first);
  const std::size_t j = to_index(pair.second);
  const Vector3d none = Vector3d::Zero();
  const Vector3d g_i = is_movable(i) ? options.gravity : none;
  const Vector3d g_j = is_movable(j) ? options.gravity : none;
  const Vector3d v = states[i].linear_velocity - states[j].linear_velocity;
  const double far = (states[i].position - states[j].position).norm() +
                     travel(pair.first, duration) + travel(pair.second, duration);
  const double spin = fastest_turn(states[i], masses[i]) * reach_of(bodies[i], far) +
                      fastest_turn(states[j], masses[j]) * reach_of(bodies[j], far);
  const double near = kNear * std::min(thickness(bodies[i].shape), thickness(bodies[j].shape));
  double t = 0.0;
  for (int k = 0; k < kMostAdvances; ++k) {
    if (is_set(stop)) return std::nullopt;
    const BodyState later_i = moved(states[i], masses[i], g_i, t);
    const BodyState later_j = moved(states[j], masses[j], g_j, t);
    const PlacedShape shape_i(bodies[i], later_i), shape_j(bodies[j], later_j);
    const Separation apart =
        separation(shape_i.shape(), shape_i.state(), shape_j.shape(), shape_j.state());
    const double left = duration - t;
    const double falling = std::max(0.0, -apart.normal.dot(g_i - g_j));
    const double closing = spin - apart.normal.dot(v + 2.0 * t * (g_i - g_j)) + left * falling;
    if (apart.gap <= near && closing > 0.0) return t;
    if (!(closing * left > apart.gap - near)) return std::nullopt;
    t += std::max(apart.gap, near) / closing;
    if (t >= duration) return std::nullopt;
  }
  return t;  // so far they are apart, and from here it is looked again
}

bool World::Impl::is_touching(const Broadphase::Pair& pair) const {
  return find(touching, pair) != nullptr;
}

// Adds pairs without points, of fast bodies that hit something and of all that they may hit then.
void World::Impl::find_hits(const List<Broadphase::Pair>& near) {
  const double h = options.time_step;
  list_jointed_pairs(near);
  // boxes are wider for groups by events
  const auto is_open = [&](const Broadphase::Pair& pair) {
    return !has_joints(pair) && is_fast(pair, h) && find(touching, pair) == nullptr &&
           !topology.is_unpaired(pair) &&
           (!follows_contacts() || gap_of(pair) <= swept(pair.first, h) + swept(pair.second, h));
  };
  List<bool> hits_something(bodies.size());
  bool any = false;
  for (const Broadphase::Pair& pair : near) {
    if (!is_open(pair) || !time_of_hit(pair, h)) continue;
    any = true;
    for (const int body : {pair.first, pair.second})
      if (is_movable(to_index(body))) hits_something[body] = true;
  }
  if (!any) return;
  List<TouchingPair> found;
  for (const Broadphase::Pair& pair : near) {
    if (!hits_something[pair.first] && !hits_something[pair.second]) continue;
    if (!is_open(pair)) continue;
    TouchingPair& hit = found.emplace_back();
    hit.a = pair.first;
    hit.b = pair.second;
    hit.id_a = body_ids[pair.first];
    hit.id_b = body_ids[pair.second];
  }
  touching.insert(touching.end(), found.begin(), found.end());
  std::sort(touching.begin(), touching.end(), TouchingPair::in_order);
}

// ---- the group

bool World::Impl::is_any_about_to_hit() const {
  return std::any_of(touching.begin(), touching.end(), [this](const TouchingPair& pair) {
    return time_to_watch(pair) < options.time_step;
  });
}

// from the pairs that hit to all that contacts and joints connect with them
void World::Impl::find_fast_group(const Carried& by_method) {
  List<bool>& is_member = fast_group.is_member;
  is_member.assign(bodies.size(), false);
  bool spreads = false;
  const auto join = [&](int body) {
    if (!is_movable(to_index(body)) || is_member[body]) return;
    spreads = true;
    for (const int other : island_parts[topology.island_of(body)].members.bodies)
      is_member[other] = true;
  };
  for (const TouchingPair& pair : touching) {
    if (time_to_watch(pair) >= options.time_step) continue;
    join(pair.a);
    join(pair.b);
  }
  while (spreads) {
    spreads = false;
    for (const TouchingPair& pair : touching) {
      if (is_member[pair.a]) join(pair.b);
      if (is_member[pair.b]) join(pair.a);
    }
  }
  for (FastGroup* group : {&fast_group, &slow_group}) {
    group->bodies.clear();
    group->joints.clear();
  }
  for (const int body : by_method.impulse_bodies)
    (is_member[body] ? fast_group : slow_group).bodies.push_back(body);
  for (const int j : by_method.impulse_joints) {
    const auto [a, b] = topology.ends(j);
    (is_member[is_movable(a) ? a : b] ? fast_group : slow_group).joints.push_back(j);
  }
}

// Pairs that may touch in a time, of the group with itself and with what does not move.
List<Broadphase::Pair> World::Impl::pairs_of_group(double duration, bool* is_any_left) {
  const List<bool>& is_member = fast_group.is_member;
  proxies.clear();
  for (const int body : moving_shapes) {
    proxies.push_back(proxy(body));
    if (is_member[body] || !is_movable(to_index(body))) sweep(duration, &proxies.back());
  }
  List<Broadphase::Pair> pairs;
  for (const Broadphase::Pair& pair : broadphase.find_pairs(proxies)) {
    const bool has_a = is_member[pair.first];
    const bool has_b = is_member[pair.second];
    if (!has_a && !has_b) continue;
    if (topology.is_unpaired(pair)) continue;
    const int other = has_a ? pair.second : pair.first;
    if (has_a != has_b && is_movable(to_index(other)))
      *is_any_left = *is_any_left || (is_fast(pair, duration) && time_of_hit(pair, duration));
    else
      pairs.push_back(pair);
  }
  if (broadphase.is_full()) fail(Failure::kTooManyPairs);
  return pairs;
}

// Finds the contacts of the group, those about to hit among them, and says whether any is a hit.
bool World::Impl::collide_group(const List<Broadphase::Pair>& near, double left) {
  const List<TouchingPair> before = std::move(touching);
  touching.clear();
  bool any_hit = false;
  for (const Broadphase::Pair& ends : near) {
    const std::size_t a = to_index(ends.first);
    const std::size_t b = to_index(ends.second);
    const double thinner = std::min(thickness(bodies[a].shape), thickness(bodies[b].shape));
    const Manifold manifold =
        collide(PlacedShape(bodies[a], states[a]), PlacedShape(bodies[b], states[b]),
                std::isfinite(thinner) ? 4.0 * kNear * thinner : 0.0);
    if (manifold.count == 0) continue;
    TouchingPair& pair = touching.emplace_back();
    pair.a = ends.first;
    pair.b = ends.second;
    pair.id_a = body_ids[a];
    pair.id_b = body_ids[b];
    pair.manifold = manifold;
    const TouchingPair* known = options.warm_starting ? find(before, ends) : nullptr;
    for (std::size_t k = 0; k < to_index(manifold.count); ++k)
      pair.impulses[k] = known != nullptr ? known->impulse_of(manifold.points[k].feature)
                                          : Vector3d::Zero().eval();
    any_hit = any_hit || is_hit(pair, left);
  }
  return any_hit;
}

// For how long a pair that touches moves no farther into each other than the rows of a contact
// hold, whatever corner comes round; 0 for one about to hit.
double World::Impl::time_to_watch(const TouchingPair& pair) const {
  if (pair.manifold.count == 0) return 0.0;
  if (has_joints(pair.ends())) return kInfinity;  // which hold it back: as contacts always had it
  const BodyState& a = states[pair.a];
  const BodyState& b = states[pair.b];
  const Body& body_a = bodies[pair.a];
  const Body& body_b = bodies[pair.b];
  const double far = (a.position - b.position).norm();
  const double closing =
      std::max(0.0, -pair.manifold.normal.dot(a.linear_velocity - b.linear_velocity)) +
      a.angular_velocity.norm() * reach_of(body_a, far) +
      b.angular_velocity.norm() * reach_of(body_b, far);
  return kFastShare * std::min(thickness(body_a.shape), thickness(body_b.shape)) / closing;
}

// whether two that touch would move into each other as far as fast ones do
bool World::Impl::is_hit(const TouchingPair& pair, double duration) const {
  const BodyState& a = states[pair.a];
  const BodyState& b = states[pair.b];
  const double thinner = std::min(thickness(bodies[pair.a].shape), thickness(bodies[pair.b].shape));
  double closing = 0.0;
  for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
    const Vector3d& p = pair.manifold.points[k].position;
    const Vector3d v = a.linear_velocity + a.angular_velocity.cross(p - a.position) -
                       b.linear_velocity - b.angular_velocity.cross(p - b.position);
    closing = std::max(closing, -v.dot(pair.manifold.normal));
  }
  return closing * duration > kFastShare * thinner;
}

// Adds the impulses of a part of the step to those before.
void World::Impl::gather_hits() {
  List<TouchingPair> all;
  for (const TouchingPair& pair : hits)
    if (find(touching, pair.ends()) == nullptr) all.push_back(pair);
  for (const TouchingPair& pair : touching) {
    all.push_back(pair);
    const TouchingPair* before = find(hits, pair.ends());
    if (before == nullptr) continue;
    Vector3d sum = Vector3d::Zero();
    for (std::size_t k = 0; k < to_index(before->manifold.count); ++k) sum += before->impulses[k];
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      const Vector3d same = before->impulse_of(pair.manifold.points[k].feature);
      all.back().impulses[k] += same;
      sum -= same;
    }
    all.back().impulses[0] += sum;  // of points that are no longer there
  }
  std::sort(all.begin(), all.end(), TouchingPair::in_order);
  hits = std::move(all);
}

// Returns the contacts of the group to those of all.
void World::Impl::take_hits() {
  for (const TouchingPair& pair : hits)
    report.contacts += static_cast<std::uint32_t>(pair.manifold.count);
  touching.insert(touching.end(), hits.begin(), hits.end());
  std::sort(touching.begin(), touching.end(), TouchingPair::in_order);
}

// ---- the tick of the group

// Carries the group on by a part of the step that begins after `done` of it.
void World::Impl::advance_group(const Tick& tick, double done, double duration) {
  if (any_corrections) take_out_corrections();
  const double share = duration / options.time_step;
  List<ActingWrench> wrenches_now;
  for (ActingWrench wrench : acting_wrenches) {
    if (!fast_group.is_member[wrench.body]) continue;
    wrench.duration *= share;
    wrenches_now.push_back(wrench);
  }
  JointStep span = joint_step(options, tick.start + done, duration);
  if (!joint_sums.empty()) span.beta *= share;  // errors close in all parts as they do in a step
  const ImpulseStep step{span,
                         fast_group.bodies,
                         fast_group.joints,
                         topology.joint_ends(),
                         topology.is_in_loop(),
                         wrenches_now,
                         stop,
                         clock};
  const std::uint32_t contacts_before = report.contacts;
  book(sequential_impulses.advance(*this, step, this));
  report.contacts = contacts_before;  // each is counted once, with the hits
  report.correction_work += sequential_impulses.finish(*this, step, this);
  for (std::size_t k = 0; k < joint_sums.size(); ++k) {
    const std::size_t j = to_index(fast_group.joints[k]);
    joint_sums[k].add(joints[j], duration, &joint_states[j]);
  }
}

void World::Impl::advance_fast_group(const Tick& tick) {
  List<TouchingPair> of_others;
  const auto is_of_group = [&](const TouchingPair& pair) {
    return fast_group.is_member[pair.a] || fast_group.is_member[pair.b];
  };
  std::stable_partition(touching.begin(), touching.end(), is_of_group);
  const auto others = std::find_if_not(touching.begin(), touching.end(), is_of_group);
  of_others.assign(others, touching.end());
  touching.erase(others, touching.end());
  hits.clear();
  const bool is_on_joints =
      std::any_of(touching.begin(), touching.end(), [this](const TouchingPair& pair) {
        return pair.manifold.count == 0 && has_joints(pair.ends());
      });

  joint_sums.assign(is_on_joints ? fast_group.joints.size() : 0, {});

  const double h = options.time_step;
  const List<BodyState> at_start = states;  // of what moves by itself
  bool is_any_left = false, was_hit = false;
  std::uint32_t found = 0;
  double done = 0.0;
  List<double> ways;
  for (int leg = 0; done < h && !is_set(stop); ++leg) {
    for (const int body : sleep.awake().kinematic)
      states[body] = moved(at_start[body], MassProperties{}, Vector3d::Zero(), done);
    const double left = h - done;
    const List<Broadphase::Pair> near = pairs_of_group(left, &is_any_left);
    ways.clear();
    const bool is_any_hit = collide_group(near, left);
    double duration = left;
    if ((found == kMostHits && !is_on_joints) || leg == kMostLegs) {
      is_any_left = true;
    } else if (is_on_joints) {
      found += is_any_hit && !was_hit ? 1 : 0;  // what sweeps leave goes on closing
      was_hit = is_any_hit;
      duration = std::max(kInstant * h, time_on_joints(near, left, &ways));
    } else if (is_any_hit) {
      ++found;
      duration = std::min(left, kInstant * h);
    } else {
      for (const int body : fast_group.bodies)
        if (reach_of(bodies[body]) > 0.0)
          duration = std::min(duration, kMostTurn / states[body].angular_velocity.norm());
      for (const TouchingPair& pair : touching) duration = std::min(duration, time_to_watch(pair));
      for (const Broadphase::Pair& pair : near)
        if (is_fast(pair, duration) && find(touching, pair) == nullptr)
          duration = std::max(kInstant * h, time_of_hit(pair, duration).value_or(duration));
    }
    const bool is_last = duration >= left;
    advance_group(tick, done, is_last ? left : duration);
    is_any_left = is_any_left || has_outrun(near, ways, is_last ? left : duration);
    gather_hits();
    done = is_last ? h : done + duration;
  }
  for (const int body : sleep.awake().kinematic) states[body] = at_start[body];
  for (std::size_t k = 0; k < joint_sums.size(); ++k) {
    const std::size_t j = to_index(fast_group.joints[k]);
    joint_sums[k].finish(joints[j], state_a(j), state_b(j), h, &joint_states[j]);
  }
  for (TouchingPair& pair : hits)
    for (Manifold::Point& point : pair.manifold.points) point.depth = std::max(point.depth, 0.0);
  report.hits += found;
  if (is_any_left) report.hits_left_body = body_ids[fast_group.bodies.front()];
  touching = std::move(of_others);
}

}  // namespace constraint_sim::engine
