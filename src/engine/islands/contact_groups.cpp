#include "engine/islands/contact_groups.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/collision/contact_feature.h"
#include "engine/collision/narrowphase.h"
#include "engine/constraints/contact.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/islands/divided_step.h"
#include "engine/islands/method_choice.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/runge_kutta/elastic_spheres.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kLeastWork = 100;  // least work limit of a group, in the unit of GroupLimits::work
constexpr double kBack = 0.85;      // share of the limits within which impulses return islands

/// Whether events advance a joint with all its laws beside contacts.
bool can_be_beside_contacts(const Joint& joint) {
  if (!is_switchable(joint)) return false;
  return !has_length(joint.kind) || length_spring(joint).is_none() || !joint.motor.is_moving();
}

/// Notes whether two shapes touched in the last step, and whether friction was within its cone at a
/// point. `mass`: reduced mass of the pair [kg], which turns a rounding of velocity into an
/// impulse.
void note_step_before(const List<TouchingPair>& before, const ShapePair& shapes, double mass,
                      ContactPair* pair) {
  // Share of the greatest friction within which an impulse counts as on the border of the cone, and
  // the point as slipping: wide against the 1e-7 within which BodyConeSolver holds a slip.
  constexpr double kNearCone = 1e-6;
  constexpr double kVelocityRounding = 1e-12;  // rounding of velocities [m/s]
  const TouchingPair* found = find_contact(before, shapes);
  if (found == nullptr) return;
  pair->touched = true;
  for (std::size_t k = 0; k < to_index(found->manifold.count); ++k) {
    const double normal = found->impulses[k].dot(found->manifold.normal);
    const double along = (found->impulses[k] - normal * found->manifold.normal).norm();
    const double most = (1.0 - kNearCone) * pair->friction * std::abs(normal);
    pair->stuck = pair->stuck || along <= most + kVelocityRounding * mass;
  }
}

/// Whether a group is small enough for events. A group with an island that impulses took over has
/// smaller limits (kBack), so that its method does not change back and forth.
bool is_small_enough(const GroupSize& size, const GroupLimits& most) {
  const double share = size.was_handed ? kBack : 1.0;
  return static_cast<double>(size.bodies) <= share * static_cast<double>(most.bodies) &&
         static_cast<double>(size.points) <= share * static_cast<double>(most.points);
}

/// Whether an island can be in a group: its joints fit, up to the errors that they close. A length
/// with a force limit that closes an error is left to impulses.
bool can_be_in_group(const StepContext& step, const State& state, const IslandParts& parts) {
  const Model& model = step.model;
  if (!suits_group(model, state.step_count, parts.members, parts.nature, parts)) return false;
  const JointStep now = joint_step(model.options, step.tick.start, model.options.time_step);
  return std::all_of(parts.members.joints.begin(), parts.members.joints.end(), [&](int index) {
    const std::size_t j = to_index(index);
    const Joint& joint = model.joints[j];
    const JointData& joint_state = state.joint_states[j];
    if (joint_state.closing && has_length(joint.kind) && joint.motor.max_force > 0.0) return false;
    return !is_rigid(joint) || fits(joint, step.topology.state_a(state, j),
                                    step.topology.state_b(state, j), now, joint_state);
  });
}

/// Compiles a group of any number of spheres on planes that keep all energy.
bool compile_spheres(const Model& model, const State& state, const IslandLists& lists,
                     const ContactReach& reach, ContactGroup* group) {
  List<ElasticSpheres::Sphere> spheres;
  double smallest = kInfinity;
  for (const int i : group->islands) {
    const IslandMembers& members = lists.island_parts[i].members;
    if (!members.joints.empty()) return false;
    const int body = members.bodies.front();
    const auto is_on_it = [&](const Wrench& wrench) { return wrench.body == model.body_ids[body]; };
    if (std::any_of(state.wrenches.begin(), state.wrenches.end(), is_on_it)) return false;
    if (model.masses[body].weight_share != 1.0) return false;  // all spheres have to fall alike
    if (!collides_with_all(model.bodies[body])) return false;
    spheres.push_back({body, 1.0 / model.masses[body].inverse_mass,
                       std::get<Sphere>(model.bodies[body].shape).radius});
    smallest = std::min(smallest, spheres.back().radius);
  }
  List<ElasticSpheres::Plane> planes;
  List<int> others;
  for (const ShapePair& pair : group->pairs)
    for (const int body : {pair.first, pair.second})
      if (!model.is_movable(to_index(body))) others.push_back(body);
  std::sort(others.begin(), others.end());
  others.erase(std::unique(others.begin(), others.end()), others.end());
  for (const int body : others) {
    if (is_moving_by_itself(model, state, to_index(body)) || !keeps_energy(model.bodies[body]) ||
        !collides_with_all(model.bodies[body]) ||
        !std::holds_alternative<Plane>(model.bodies[body].shape))
      return false;
    const BodyState& plane = state.states[body];
    planes.push_back({body, plane.orientation * Vector3d::UnitZ(), plane.position});
  }
  // Where only these spheres and planes collide, a sphere meets nothing else at any speed.
  const bool is_all = std::count_if(model.bodies.begin(), model.bodies.end(), may_touch) ==
                      static_cast<std::ptrdiff_t>(spheres.size() + planes.size());
  const double most_speed =
      is_all ? kInfinity : reach.travel_bound(spheres.front().body) / model.options.time_step;
  group->spheres =
      std::make_shared<ElasticSpheres>(std::move(spheres), std::move(planes), most_speed);
  if (group->spheres->begin(state.states, ContactTolerances(smallest).overlap)) return true;
  group->spheres.reset();
  return false;
}

}  // namespace

bool suits_group(const Model& model, std::uint64_t step_count, const IslandMembers& members,
                 MethodReason nature, const IslandMemory& memory) {
  const bool is_by_events =
      method_for(nature, model.options) == Method::kEventDriven && members.joints.size() > 0;
  if (!(nature == MethodReason::kSmooth || is_by_events) || memory.is_stiff ||
      step_count < memory.refused_until || step_count < memory.contacts_refused_until ||
      step_count < memory.inconsistent_until)
    return false;
  return std::all_of(members.joints.begin(), members.joints.end(),
                     [&](int j) { return can_be_beside_contacts(model.joints[j]); });
}

void ContactGroups::find(const StepContext& step, const State& state, const Rollback& rollback,
                         const IslandLists& lists, const AwakeSets& awake,
                         const ContactReach& reach, const List<TouchingPair>& touching_before) {
  clear();
  if (reach.watched_pairs().empty()) return;
  const Topology& topology = step.topology;
  group_at_.assign(lists.islands.size(), -1);
  left_for_.assign(lists.islands.size(), MethodReason::kContact);
  for (const auto& [pair, apart] : reach.watched_pairs()) {
    const int island = std::max(topology.island_of(pair.first), topology.island_of(pair.second));
    const int leader = reach.leader_of(to_index(island));
    const GroupSize& size = reach.size_of_group(leader);
    const bool is_small = is_small_enough(size, group_limits(step.model.options));
    if (!(is_small || size.is_elastic))
      left_for_[leader] = MethodReason::kManyContacts;
    else if (size.overlaps && !size.is_settled)
      left_for_[leader] = MethodReason::kOverlap;
    if (left_for_[leader] != MethodReason::kContact) continue;
    if (group_at_[leader] < 0) {
      group_at_[leader] = static_cast<int>(groups_.size());
      ContactGroup& group = add();
      group.is_small_enough = is_small;
      group.is_elastic = size.is_elastic;
      group.closes = size.overlaps;
    }
    groups_[group_at_[leader]].pairs.push_back(pair);
  }
  for (const int i : awake.islands) {
    const int group = group_at_[reach.leader_of(to_index(i))];
    if (group >= 0) groups_[group].islands.push_back(i);
  }
  std::size_t kept = 0;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    if (!compile(step, state, rollback, lists, reach, touching_before, &groups_[g])) continue;
    if (kept != g) std::swap(groups_[kept], groups_[g]);
    ++kept;
  }
  clear(kept);
  group_of_.assign(lists.islands.size(), -1);
  for (std::size_t g = 0; g < groups_.size(); ++g)
    for (const int i : groups_[g].islands) group_of_[i] = static_cast<int>(g);
}

MethodReason ContactGroups::why_left(const ContactReach& reach, std::size_t island) const {
  if (reach.watched_pairs().empty()) return MethodReason::kContact;
  return left_for_[reach.leader_of(island)];
}

bool ContactGroups::is_left_in_contact(const StepContext& step, const State& state,
                                       const ContactReach& reach, std::size_t island) const {
  if (contains(island)) return false;
  const auto is_of_it = [&](int body) {
    return step.topology.island_of(body) == static_cast<int>(island);
  };
  const auto& pairs = reach.watched_pairs();
  return std::any_of(pairs.begin(), pairs.end(), [&](const auto& watched) {
    const auto& [pair, apart] = watched;
    return (is_of_it(pair.first) || is_of_it(pair.second)) &&
           apart.gap <= tolerances_of(step.model, state, pair).touching;
  });
}

// Removes all groups but the first `kept`. Later groups reuse the storage of removed groups.
void ContactGroups::clear(std::size_t kept) {
  while (groups_.size() > kept) {
    unused_.push_back(std::move(groups_.back()));
    groups_.pop_back();
  }
}

ContactGroup& ContactGroups::add() {
  if (unused_.empty()) return groups_.emplace_back();
  ContactGroup& group = groups_.emplace_back(std::move(unused_.back()));
  unused_.pop_back();
  group.islands.clear();
  group.pairs.clear();
  group.spheres.reset();
  group.has_failed = group.is_found = false;
  return group;
}

void ContactGroups::list_bodies(const Model& model, const IslandLists& lists,
                                const AwakeSets& awake) {
  bodies_.clear();
  for (const int i : awake.islands)
    if (lists.islands[i].why == MethodReason::kFewContacts)
      for (const int body : lists.island_parts[i].members.bodies)
        bodies_.push_back(model.body_ids[body]);
}

// Compiles the equations of a group; false where its islands are left to other methods.
bool ContactGroups::compile(const StepContext& step, const State& state, const Rollback& rollback,
                            const IslandLists& lists, const ContactReach& reach,
                            const List<TouchingPair>& touching_before, ContactGroup* group) {
  for (const int i : group->islands)
    if (!can_be_in_group(step, state, lists.island_parts[i])) return false;
  if (group->is_elastic && !group->closes &&
      compile_spheres(step.model, state, lists, reach, group))
    return true;
  if (!group->is_small_enough) return false;
  place_.resize(step.model.bodies.size(), -1);
  group->events.make();
  ContactEquations& equations = group->events->equations();
  const bool is_compiled = compile_events(step, rollback, lists, touching_before, *group);
  for (const GroupBody& body : equations.bodies().list()) place_[body.index] = -1;
  return is_compiled && group->events->begin(state.states, group->closes);
}

std::size_t ContactGroups::add_body(const Model& model, int body, GroupBodies* bodies) {
  int& place = place_[body];
  if (place < 0) {
    place = static_cast<int>(bodies->list().size());
    GroupBody& added = bodies->list().emplace_back();
    added.index = body;
    added.mass = model.masses[body];
  }
  return to_index(place);
}

// Compiles bodies, joints and pairs of a group.
bool ContactGroups::compile_events(const StepContext& step, const Rollback& rollback,
                                   const IslandLists& lists,
                                   const List<TouchingPair>& touching_before,
                                   const ContactGroup& group) {
  const Model& model = step.model;
  GroupBodies& bodies = group.events->equations().bodies();
  GroupJoints& joints = group.events->equations().joints();
  bodies.list().clear();
  bodies.shapes().clear();
  joints.coordinates().clear();
  for (const int i : group.islands)
    for (const int body : lists.island_parts[i].members.bodies) add_body(model, body, &bodies);
  bodies.set_movable(bodies.list().size());
  std::size_t count = 0;
  for (const int i : group.islands) {
    for (const int index : lists.island_parts[i].members.joints) {
      if (count == joints.list().size()) joints.list().emplace_back();
      GroupJoint& joint = joints.list()[count];
      const auto [a, b] = step.topology.ends(index);
      static_cast<GroupJointState&>(joint) = {index, add_body(model, static_cast<int>(a), &bodies),
                                              add_body(model, static_cast<int>(b), &bodies)};
      joint.joint = model.joints[index];
      joint.was_saturated = rollback.joint_states()[index].saturated;
      joints.add_coordinates(count);
      ++count;
    }
  }
  joints.list().resize(count);
  for (std::size_t j = 0; j < count; ++j) {
    const auto index = to_index(joints[j].index);
    if (info(model.joints[index].kind).couples && !joints.set_terms(j, model.terms_of(index)))
      return false;
  }
  return add_pairs(step, touching_before, group);
}

bool ContactGroups::add_pairs(const StepContext& step, const List<TouchingPair>& touching_before,
                              const ContactGroup& group) {
  const Model& model = step.model;
  GroupBodies& bodies = group.events->equations().bodies();
  List<ContactPair>& pairs = group.events->pairs();
  pairs.clear();
  for (const ShapePair& shapes : group.pairs) {
    auto [a, b] = shapes.bodies();
    int part_a = shapes.part_first, part_b = shapes.part_second;
    if (!has_features(part_of(model.bodies[a].shape, part_a),
                      part_of(model.bodies[b].shape, part_b))) {
      std::swap(a, b);
      std::swap(part_a, part_b);
    }
    const Body& body_a = model.bodies[a];
    const Body& body_b = model.bodies[b];
    const Shape& shape_a = part_of(body_a.shape, part_a);
    const Shape& shape_b = part_of(body_b.shape, part_b);
    if (!has_features(shape_a, shape_b)) return false;
    const ContactSurface surface(body_a, part_a, body_b, part_b);
    const std::size_t place_a = add_body(model, a, &bodies);
    const std::size_t place_b = add_body(model, b, &bodies);
    pairs.push_back({place_a, place_b, bodies.shapes().add(body_a, place_a, part_a),
                     bodies.shapes().add(body_b, place_b, part_b), shape_a, shape_b,
                     surface.friction, surface.restitution, 0, 0,
                     std::min(thickness(shape_a), thickness(shape_b)),
                     (step.assumed.of(a) + step.assumed.of(b)) / model.options.time_step});
    const double mass = 1.0 / (model.masses[a].inverse_mass + model.masses[b].inverse_mass);
    note_step_before(touching_before, shapes, mass, &pairs.back());
  }
  return true;
}

// Returns the work that a group may take in this step. With `method: auto` all groups share a
// limit.
double ContactGroups::most_work_of(const WorldOptions& options, const ContactGroup& of) const {
  double left = group_limits(options).work;
  if (options.method == Method::kEventDriven) return left;
  for (const ContactGroup& group : groups_)
    if (&group != &of && group.spheres == nullptr) left -= group.events->work();
  return std::max(left, kLeastWork);
}

IntegrationResult ContactGroups::advance(std::size_t group, const Interval& interval,
                                         const IntegratorOptions& options,
                                         const WorldOptions& world_options, State* state) {
  ContactGroup& of = groups_[group];
  if (of.spheres != nullptr) return of.spheres->advance(interval, options, &state->states);
  return of.events->advance(interval, options, joint_step(world_options, interval.t, interval.h),
                            state->joint_states, most_work_of(world_options, of), &state->states);
}

void ContactGroups::take_out_contacts(const Topology& topology,
                                      List<TouchingPair>* touching) const {
  const auto is_of_group = [&](const TouchingPair& pair) {
    const int island = std::max(topology.island_of(pair.a), topology.island_of(pair.b));
    if (!contains(to_index(island))) return false;
    const ContactGroup& group = groups_[group_of_[island]];
    return !group.has_failed || group.is_found;
  };
  touching->erase(std::remove_if(touching->begin(), touching->end(), is_of_group), touching->end());
}

std::uint32_t ContactGroups::events_of(std::size_t island) const {
  const ContactGroup& group = groups_[group_of_[island]];
  if (group.islands.front() != static_cast<int>(island)) return 0;
  return group.spheres != nullptr ? static_cast<std::uint32_t>(group.spheres->hits().size())
                                  : group.events->events();
}

double ContactGroups::driven_work_of(std::size_t island) const {
  if (!contains(island)) return 0.0;
  const ContactGroup& group = groups_[group_of_[island]];
  if (group.islands.front() != static_cast<int>(island) || group.spheres != nullptr) return 0.0;
  return group.events->equations().driven_work();
}

}  // namespace constraint_sim::engine
