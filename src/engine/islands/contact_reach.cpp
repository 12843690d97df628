#include "engine/islands/contact_reach.h"

#include <algorithm>
#include <cmath>

#include "engine/collision/placed_shape.h"
#include "engine/islands/motion_bounds.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Limits with `method: event_driven` and with `method: auto`. With `auto` all groups of a step
// share the work, and each group has at least kLeastWork.
constexpr GroupLimits kForced{32, 64, 1.0}, kAuto{8, 48, 0.075};  // shares of the work
// Impulses leave contacts at rest with overlaps of ½ g h² to g h² in each contact of a stack.
// Events close overlaps up to a multiple of that, and up to a share of the thinner shape, that
// change in a step by no more than a multiple of the overlap.
constexpr double kSunk = 4.0, kSunkShare = 0.1, kMostMoved = 4.0;

/// A lower bound of the gap of two bodies [m]: shapes are within spheres, or beyond a plane.
double least_gap(const Model& model, const State& state, std::size_t a, std::size_t b) {
  if (std::holds_alternative<Plane>(model.bodies[a].shape)) std::swap(a, b);
  const Vector3d apart = state.states[a].position - state.states[b].position;
  if (!std::holds_alternative<Plane>(model.bodies[b].shape))
    return apart.norm() - extent(model.bodies[a]) - extent(model.bodies[b]);
  return apart.dot(state.states[b].orientation * Vector3d::UnitZ()) - extent(model.bodies[a]);
}

/// A lower bound of the gap of two cylinders whose axes cross [m]: their gap along the common
/// normal of the axes, where each is as wide as its radius. Minus infinity of other pairs.
double gap_across(const Model& model, const State& state, const Broadphase::Pair& pair) {
  const PlacedShape a(model.bodies[pair.first], pair.part_first, state.states[pair.first]),
      b(model.bodies[pair.second], pair.part_second, state.states[pair.second]);
  const auto* of_a = std::get_if<Cylinder>(&a.shape());
  const auto* of_b = std::get_if<Cylinder>(&b.shape());
  if (of_a == nullptr || of_b == nullptr) return -kInfinity;
  const Vector3d normal =
      (a.state().orientation * Vector3d::UnitZ()).cross(b.state().orientation * Vector3d::UnitZ());
  // Sine of the angle between the axes below which their common normal is too inexact for a bound:
  // rounding turns it by 1e-16 over the sine.
  constexpr double kLeastCrossingSine = 1e-3;
  const double sine = normal.norm();
  if (sine < kLeastCrossingSine) return -kInfinity;
  return std::abs(normal.dot(a.state().position - b.state().position)) / sine - of_a->radius -
         of_b->radius;
}

/// Whether an overlap is no deeper than impulses leave overlaps at rest, and changes slowly.
bool is_settled(const StepContext& step, const State& state, const Broadphase::Pair& pair,
                const Separation& apart) {
  const Model& model = step.model;
  const double h = model.options.time_step;
  const std::size_t a = to_index(pair.first), b = to_index(pair.second);
  const double most =
      std::min(kSunkShare * thinner_of(model, pair), kSunk * h * h * model.options.gravity.norm());
  if (-apart.gap > most) return false;
  double moved = 0.0;
  for (const auto& [body, sign] : {std::pair(pair.first, 1.0), std::pair(pair.second, -1.0)}) {
    Vector3d v = state.states[body].linear_velocity;
    if (state.any_corrections) v -= state.corrections[body].head<3>();
    moved += sign * h * apart.normal.dot(v);
  }
  const BodyState &now_a = state.states[a], &now_b = state.states[b];
  const double turned = max_point_displacement(step, now_a, pair.first, h) -
                        max_center_displacement(step, now_a, pair.first, h) +
                        max_point_displacement(step, now_b, pair.second, h) -
                        max_center_displacement(step, now_b, pair.second, h);
  return std::abs(moved) + turned <= kMostMoved * most;
}

}  // namespace

GroupLimits group_limits(const WorldOptions& options) {
  GroupLimits limits = options.method == Method::kAuto ? kAuto : kForced;
  limits.work *= options.event_work;
  return limits;
}

bool keeps_energy(const Body& body) {
  return body.friction == 0.0 && body.restitution == 1.0 && !body.shape_pose;
}

bool is_elastic_sphere(const Model& model, std::size_t body) {
  const Vector3d& inertia = model.masses[body].inertia;
  return std::holds_alternative<Sphere>(model.bodies[body].shape) &&
         keeps_energy(model.bodies[body]) && inertia.x() == inertia.y() &&
         inertia.y() == inertia.z();
}

// Gives all elastic spheres the travel bound of the fastest elastic sphere from the start, since a
// group of very many spheres would grow too slowly.
void ContactReach::begin(const StepContext& step, const State& state,
                         const List<int>& moving_shapes) {
  const Model& model = step.model;
  travel_bounds_.assign(model.bodies.size(), 0.0);
  double of_elastic = 0.0;
  for (const int body : moving_shapes) {
    travel_bounds_[body] =
        2.0 * max_point_displacement(step, state.states[body], body, model.options.time_step) +
        kTouching;
    if (is_elastic_sphere(model, to_index(body)))
      of_elastic = std::max(of_elastic, travel_bounds_[body]);
  }
  for (const int body : moving_shapes)
    if (of_elastic > 0.0 && is_elastic_sphere(model, to_index(body)))
      travel_bounds_[body] = of_elastic;
  own_travel_bounds_ = travel_bounds_;
}

bool ContactReach::grow(const StepContext& step, const State& state, const IslandLists& lists,
                        const AwakeSets& awake, const List<Broadphase::Pair>& pairs) {
  const Model& model = step.model;
  watch_pairs(step, state, lists.islands.size(), pairs);
  if (watched_pairs_.empty()) return false;
  list_group_sizes(step, state, lists, awake);
  if (watched_pairs_.empty()) return false;
  bool any_grown = false;
  for (const int i : awake.islands) {
    const GroupSize& size = sizes_[leader_of(to_index(i))];
    if (!size.has_pairs || !(size.is_elastic || size.bodies <= group_limits(model.options).bodies))
      continue;
    for (const int body : lists.island_parts[i].members.bodies) {
      if (travel_bounds_[body] >= size.travel_bound) continue;
      travel_bounds_[body] = size.travel_bound;
      any_grown = true;
    }
  }
  return any_grown;
}

// Connects the islands of pairs that may touch. The first island of a set leads it.
// Watches nothing once the step is asked to stop.
void ContactReach::watch_pairs(const StepContext& step, const State& state, std::size_t islands,
                               const List<Broadphase::Pair>& pairs) {
  const Topology& topology = step.topology;
  watched_pairs_.clear();
  groups_.reset(islands);
  for (const Broadphase::Pair& pair : pairs) {
    if (is_set(step.stop)) return watched_pairs_.clear();
    const auto apart = separation_to_watch(step.model, topology, state, pair);
    if (!apart) continue;
    watched_pairs_.push_back({pair, *apart});
    const int a = topology.island_of(pair.first), b = topology.island_of(pair.second);
    if (a >= 0 && b >= 0) groups_.join(a, b);
  }
  if (watched_pairs_.empty()) return;
  groups_.flatten();
}

// Counts the members of possible groups, by leader: most groups in a heap are too large, and need
// no list of members. Watches nothing once the step is asked to stop: groups must not be formed
// from sizes that are not counted.
void ContactReach::list_group_sizes(const StepContext& step, const State& state,
                                    const IslandLists& lists, const AwakeSets& awake) {
  const Model& model = step.model;
  const Topology& topology = step.topology;
  sizes_.assign(lists.islands.size(), GroupSize{});
  for (const auto& [pair, apart] : watched_pairs_) {
    if (is_set(step.stop)) return watched_pairs_.clear();
    const int island = std::max(topology.island_of(pair.first), topology.island_of(pair.second));
    GroupSize& size = sizes_[leader_of(to_index(island))];
    size.has_pairs = true;
    for (const int body : {pair.first, pair.second})  // kinematic bodies may hit the others
      if (!model.is_movable(to_index(body)))
        size.travel_bound = std::max(size.travel_bound, travel_bounds_[body]);
    // Points count where the pair can touch without a third body that hits one of both.
    if (apart.gap <= own_travel_bounds_[pair.first] + own_travel_bounds_[pair.second])
      size.points +=
          ContactPairs::most_points(part_of(model.bodies[pair.first].shape, pair.part_first),
                                    part_of(model.bodies[pair.second].shape, pair.part_second));
    if (apart.gap >= 0.0 || (size.overlaps && !size.is_settled)) continue;
    if (apart.gap >= -tolerances_of(model, state, pair).overlap) continue;
    size.overlaps = true;
    size.is_settled = size.is_settled && is_settled(step, state, pair, apart);
  }
  for (const int i : awake.islands) {
    GroupSize& size = sizes_[leader_of(to_index(i))];
    size.was_handed = size.was_handed || lists.island_parts[i].left_for != MethodReason::kSmooth;
    const List<int>& members = lists.island_parts[i].members.bodies;
    size.bodies += members.size();
    size.is_elastic = size.is_elastic && members.size() == 1 &&
                      is_elastic_sphere(model, to_index(members.front()));
    for (const int body : members)
      size.travel_bound = std::max(size.travel_bound, travel_bounds_[body]);
  }
}

// Returns the separation of a pair that may touch within the step; empty for other pairs.
std::optional<Separation> ContactReach::separation_to_watch(const Model& model,
                                                            const Topology& topology,
                                                            const State& state,
                                                            const Broadphase::Pair& pair) const {
  const double most = travel_bounds_[pair.first] + travel_bounds_[pair.second];
  if (least_gap(model, state, to_index(pair.first), to_index(pair.second)) > most ||
      topology.is_unpaired(pair.bodies()) || gap_across(model, state, pair) > most)
    return std::nullopt;
  const Separation apart = separation_of(model, state, pair);
  if (apart.gap > most) return std::nullopt;
  return apart;
}

}  // namespace constraint_sim::engine
