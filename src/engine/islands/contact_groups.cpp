// Islands that may touch each other, or what does not move, within a step, and are few enough to be
// carried from event to event together: between stages 2 and 3 of a step. Only with `method: auto`
// and `event_driven`. A group has no memory: it is found anew in each step, from where the bodies
// are, and takes the storage of one of the step before.

#include <algorithm>
#include <cmath>

#include "engine/collision/narrowphase.h"
#include "engine/constraints/contact.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/runge_kutta/elastic_spheres.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// What a few are: in a group, and what it may cost in a step, in substeps of one with one point.
struct Few {
  std::size_t bodies, points;
  double work;
};
// Where the world chooses, groups have that work together, and each at least some of its own.
constexpr Few kAskedFor{32, 64, 2e4}, kChosen{8, 48, 1.5e3};
constexpr double kLeastWork = 100;
constexpr double kBack = 0.85;  // of these bodies and points come back from impulses
// What impulses leave of contacts at rest is ½ g h² to g h² in each of those that bear each other;
// what is closed is that much, and a share of the thinner shape, and moves into or out of the other
// by no more than a few times that in a step.
constexpr double kSunk = 4.0, kSunkShare = 0.1, kMostMoved = 4.0;

const Few& few(const WorldOptions& options) {
  return options.method == Method::kAuto ? kChosen : kAskedFor;
}

/// Whether events carry what acts of a joint beside contacts.
bool can_be_beside_contacts(const Joint& joint) {
  if (couples(joint.kind) || is_custom(joint.kind) || !is_switchable(joint)) return false;
  return !has_length(joint.kind) || length_spring(joint).is_none() || !joint.motor.is_moving();
}

/// Adds the coordinates of a joint of `equations` on which something acts.
void add_coordinates(std::size_t j, List<OneSidedLaw>* of_joint, ContactEquations* equations) {
  ContactEquations::BodyJoint& of = equations->joints[j];
  const Joint& joint = of.joint;
  List<OneSidedLaw>& laws = *of_joint;
  laws.clear();
  add_one_sided_laws(joint, j, &laws);
  const auto add = [&](const OneSidedLaw& law) -> ContactEquations::Coordinate& {
    ContactEquations::Coordinate& coordinate = equations->coordinates.emplace_back();
    coordinate.joint = j;
    coordinate.law = law;
    return coordinate;
  };
  if (has_length(joint.kind)) {
    const SoftLaw spring = length_spring(joint);
    of.has_rows = laws.empty() && spring.is_none();
    if (of.has_rows) return;
    OneSidedLaw law;
    if (!laws.empty()) law = laws.front();
    law.is_distance = true;
    law.form = ScalarForm(LengthForm{});
    if (law.servo_most == 0.0) law.soft = {spring.K, 0.0, spring.C, 0.0};
    add(law).is_one_sided = !laws.empty();
    return;
  }
  const JointKindInfo& kind = info(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& from = joint.coordinates[i];
    const auto found = std::find_if(laws.begin(), laws.end(),
                                    [&](const OneSidedLaw& law) { return law.coordinate == i; });
    OneSidedLaw law;
    if (found != laws.end()) {
      law = *found;
    } else {
      law.coordinate = i;
      law.form = kind.coordinate[i];
      law.zero = from.zero;
      law.function = kind.rows + i;
      law.soft = soft_law(from);
    }
    const bool acts = found != laws.end() || is_held(from) || !law.soft.is_none();
    if (!acts) continue;
    ContactEquations::Coordinate& coordinate = add(law);
    coordinate.is_prescribed = is_held(from);
    coordinate.is_one_sided = found != laws.end();
  }
}

/// What is known of a pair from the step before: whether it touched, and whether friction was
/// within its cone anywhere. `mass`: what takes the impulses.
void note_step_before(const List<TouchingPair>& before, std::pair<int, int> ends, double mass,
                      ContactEvents::Pair* pair) {
  constexpr double kAtCone = 1e-6;
  constexpr double kRounding = 1e-12;  // [m/s]
  const auto found = std::lower_bound(
      before.begin(), before.end(), ends,
      [](const TouchingPair& l, const std::pair<int, int>& r) { return l.ends() < r; });
  if (found == before.end() || found->ends() != ends) return;
  pair->touched = true;
  for (std::size_t k = 0; k < to_index(found->manifold.count); ++k) {
    const double normal = found->impulses[k].dot(found->manifold.normal);
    const double along = (found->impulses[k] - normal * found->manifold.normal).norm();
    const double most = (1.0 - kAtCone) * pair->friction * std::abs(normal);
    pair->stuck = pair->stuck || along <= most + kRounding * mass;
  }
}

/// Whether hits of a body with such ones cost nothing.
bool keeps_energy(const Body& body) {
  return body.friction == 0.0 && body.restitution == 1.0 && !body.shape_pose;
}

}  // namespace

bool World::Impl::follows_contacts() const { return engine::follows_contacts(options); }

std::size_t World::Impl::most_bodies_of_group() const { return few(options).bodies; }

// Islands that pairs connect, directly or by others, as grow_reach() has found them.
void World::Impl::find_contact_groups(const List<Broadphase::Pair>& near) {
  clear_contact_groups();
  if (!follows_contacts() || near.empty() || watched_pairs.empty()) return;
  for (const auto& [pair, gap] : watched_pairs) {
    const int island = std::max(topology.island_of(pair.first), topology.island_of(pair.second));
    GroupSize& size = group_sizes[leader_of[island]];
    if (!(is_few(size) || size.is_elastic))
      size.left_for = MethodReason::kManyContacts;
    else if (size.overlaps && !size.is_settled)
      size.left_for = MethodReason::kOverlap;
    if (size.left_for != MethodReason::kContact) continue;
    if (size.group < 0) {
      size.group = static_cast<int>(contact_groups.size());
      ContactGroup& group = add_contact_group();
      group.is_few = is_few(size);
      group.is_elastic = size.is_elastic;
      group.closes = size.overlaps;
    }
    contact_groups[size.group].pairs.push_back(pair);
  }
  for (const int i : sleep.awake().islands) {
    const int group = group_sizes[leader_of[i]].group;
    if (group >= 0) contact_groups[group].islands.push_back(i);
  }
  std::size_t kept = 0;
  for (std::size_t g = 0; g < contact_groups.size(); ++g) {
    if (!compile_group(&contact_groups[g])) continue;
    if (kept != g) std::swap(contact_groups[kept], contact_groups[g]);
    ++kept;
  }
  clear_contact_groups(kept);
  group_of.assign(islands.size(), -1);
  for (std::size_t g = 0; g < contact_groups.size(); ++g)
    for (const int i : contact_groups[g].islands) group_of[i] = static_cast<int>(g);
}

// those that were handed over come back when there are fewer, so that they do not come and go
bool World::Impl::is_few(const GroupSize& size) const {
  const double share = size.was_handed ? kBack : 1.0;
  return static_cast<double>(size.bodies) <= share * static_cast<double>(few(options).bodies) &&
         static_cast<double>(size.points) <= share * static_cast<double>(few(options).points);
}

// Whether an overlap is what impulses leave at rest, or less, and neither grows nor falls fast.
bool World::Impl::is_settled(const Broadphase::Pair& pair, double gap) const {
  const double h = options.time_step;
  const std::size_t a = to_index(pair.first), b = to_index(pair.second);
  const double most =
      std::min(kSunkShare * thinner_of(*this, pair), kSunk * h * h * options.gravity.norm());
  if (-gap > most) return false;
  const PlacedShape of_a(bodies[a], states[a]), of_b(bodies[b], states[b]);
  const Vector3d n = separation(of_a.shape(), of_a.state(), of_b.shape(), of_b.state()).normal;
  double moved = 0.0;
  for (const auto& [body, sign] : {std::pair(pair.first, 1.0), std::pair(pair.second, -1.0)}) {
    Vector3d v = states[body].linear_velocity;
    if (any_corrections) v -= corrections[body].head<3>();
    moved += sign * h * n.dot(v);
  }
  const double turned = max_point_displacement(*this, *this, pair.first, h) -
                        max_center_displacement(*this, *this, pair.first, h) +
                        max_point_displacement(*this, *this, pair.second, h) -
                        max_center_displacement(*this, *this, pair.second, h);
  return std::abs(moved) + turned <= kMostMoved * most;
}

// of an island in contact that is in no group
MethodReason World::Impl::why_left(std::size_t island) const {
  if (watched_pairs.empty()) return MethodReason::kContact;
  return group_sizes[leader_of[island]].left_for;
}

// whether it is in no group, and touches something
bool World::Impl::is_left_in_contact(std::size_t island) const {
  if (is_in_group(island)) return false;
  const auto is_of_it = [&](int body) {
    return topology.island_of(body) == static_cast<int>(island);
  };
  return std::any_of(watched_pairs.begin(), watched_pairs.end(), [&](const auto& watched) {
    const auto& [pair, gap] = watched;
    return gap <= kTouching && (is_of_it(pair.first) || is_of_it(pair.second));
  });
}

// All but the first ones.
void World::Impl::clear_contact_groups(std::size_t kept) {
  while (contact_groups.size() > kept) {
    unused_groups.push_back(std::move(contact_groups.back()));
    contact_groups.pop_back();
  }
}

ContactGroup& World::Impl::add_contact_group() {
  if (unused_groups.empty()) return contact_groups.emplace_back();
  ContactGroup& group = contact_groups.emplace_back(std::move(unused_groups.back()));
  unused_groups.pop_back();
  group.islands.clear();
  group.pairs.clear();
  group.spheres.reset();
  group.has_failed = false;
  return group;
}

// who is in a group, as islands were sorted
void World::Impl::list_grouped_bodies() {
  grouped_bodies.clear();
  for (const int i : sleep.awake().islands)
    if (islands[i].why == MethodReason::kFewContacts)
      for (const int body : island_parts[i].members.bodies)
        grouped_bodies.push_back(body_ids[body]);
}

// Whether an island of this kind can be in a group, wherever its bodies are.
bool World::Impl::suits_group(const IslandMembers& members, MethodReason nature,
                              const IslandMemory& memory) const {
  const bool is_by_events =
      method_for(nature, options) == Method::kEventDriven && members.joints.size() > 0;
  if (!(nature == MethodReason::kSmooth || is_by_events) || memory.is_stiff ||
      step_count < memory.refused_until || step_count < memory.contacts_refused_until ||
      step_count < memory.inconsistent_until)
    return false;
  return std::all_of(members.joints.begin(), members.joints.end(),
                     [&](int j) { return can_be_beside_contacts(joints[j]); });
}

// Whether all that an island has can be in a group.
bool World::Impl::can_be_in_group(std::size_t i) const {
  const IslandParts& parts = island_parts[i];
  if (!suits_group(parts.members, parts.nature, parts)) return false;
  const JointStep now = joint_step(options, time(), options.time_step);
  return std::all_of(parts.members.joints.begin(), parts.members.joints.end(), [&](int index) {
    const std::size_t j = to_index(index);
    JointState state = joint_states[j];
    return !state.closing &&
           (!is_rigid(joints[j]) || fits(joints[j], state_a(j), state_b(j), now, state));
  });
}

// The group with its equations; false where it is left to others.
bool World::Impl::compile_group(ContactGroup* group) {
  for (const int i : group->islands)
    if (!can_be_in_group(to_index(i))) return false;
  if (group->is_elastic && !group->closes && compile_spheres(group)) return true;
  if (!group->is_few) return false;
  place_in_group.resize(bodies.size(), -1);
  group->events.make();
  ContactEquations& equations = group->events->equations();
  const bool is_compiled = compile_events(*group);
  for (const ContactEquations::Body& body : equations.bodies) place_in_group[body.index] = -1;
  return is_compiled && group->events->begin(states, group->closes);
}

std::size_t World::Impl::add_group_body(int body, ContactEquations* equations) {
  int& place = place_in_group[body];
  if (place < 0) {
    place = static_cast<int>(equations->bodies.size());
    ContactEquations::Body& added = equations->bodies.emplace_back();
    added.index = body;
    added.mass = masses[body];
    added.shape_pose = bodies[body].shape_pose;
  }
  return to_index(place);
}

// Bodies, joints and pairs of a group.
bool World::Impl::compile_events(const ContactGroup& group) {
  ContactEquations& equations = group.events->equations();
  equations.bodies.clear();
  equations.coordinates.clear();
  for (const int i : group.islands)
    for (const int body : island_parts[i].members.bodies) add_group_body(body, &equations);
  equations.movable = equations.bodies.size();
  std::size_t count = 0;
  for (const int i : group.islands) {
    for (const int index : island_parts[i].members.joints) {
      if (count == equations.joints.size()) equations.joints.emplace_back();
      ContactEquations::BodyJoint& joint = equations.joints[count];
      const auto [a, b] = topology.ends(index);
      Joint storage = std::move(joint.joint);  // nothing else is left of the step before
      joint = {index, add_group_body(static_cast<int>(a), &equations),
               add_group_body(static_cast<int>(b), &equations), std::move(storage)};
      joint.joint = joints[index];
      joint.was_saturated = rollback.joint_states()[index].saturated;
      add_coordinates(count, &group_laws, &equations);
      ++count;
    }
  }
  equations.joints.resize(count);
  return equations.coordinates.size() <= ContactEvents::kMostLaws && add_group_pairs(group);
}

bool World::Impl::add_group_pairs(const ContactGroup& group) {
  ContactEquations& equations = group.events->equations();
  List<ContactEvents::Pair>& pairs = group.events->pairs();
  pairs.clear();
  for (auto [a, b] : group.pairs) {
    if (!has_features(bodies[a].shape, bodies[b].shape)) std::swap(a, b);
    const Body& body_a = bodies[a];
    const Body& body_b = bodies[b];
    if (!has_features(body_a.shape, body_b.shape)) return false;
    const ContactSurface surface(body_a, body_b);
    const std::size_t place_a = add_group_body(a, &equations);
    const std::size_t place_b = add_group_body(b, &equations);
    pairs.push_back({place_a, place_b, body_a.shape, body_b.shape, surface.friction,
                     surface.restitution, 0, 0,
                     std::min(thickness(body_a.shape), thickness(body_b.shape))});
    const double mass = 1.0 / (masses[a].inverse_mass + masses[b].inverse_mass);
    note_step_before(touching_before, std::minmax(a, b), mass, &pairs.back());
  }
  return true;
}

bool World::Impl::is_elastic_sphere(std::size_t body) const {
  const Vector3d& inertia = masses[body].inertia;
  return std::holds_alternative<Sphere>(bodies[body].shape) && keeps_energy(bodies[body]) &&
         inertia.x() == inertia.y() && inertia.y() == inertia.z();
}

// The same of any number of spheres that keep all energy, on planes.
bool World::Impl::compile_spheres(ContactGroup* group) {
  List<ElasticSpheres::Sphere> spheres;
  for (const int i : group->islands) {
    const IslandMembers& members = island_parts[i].members;
    if (!members.joints.empty()) return false;
    const int body = members.bodies.front();
    const auto is_on_it = [&](const Wrench& wrench) { return wrench.body == body_ids[body]; };
    if (std::any_of(wrenches.begin(), wrenches.end(), is_on_it)) return false;
    spheres.push_back(
        {body, 1.0 / masses[body].inverse_mass, std::get<Sphere>(bodies[body].shape).radius});
  }
  List<ElasticSpheres::Plane> planes;
  List<int> others;
  for (const auto& [a, b] : group->pairs)
    for (const int body : {a, b})
      if (!is_movable(to_index(body))) others.push_back(body);
  std::sort(others.begin(), others.end());
  others.erase(std::unique(others.begin(), others.end()), others.end());
  for (const int body : others) {
    if (is_moving_by_itself(*this, *this, to_index(body)) || !keeps_energy(bodies[body]) ||
        !std::holds_alternative<Plane>(bodies[body].shape))
      return false;
    const BodyState& state = states[body];
    planes.push_back({body, state.orientation * Vector3d::UnitZ(), state.position});
  }
  // where all that can touch is among them, they can meet nothing else however fast they get
  const bool is_all = std::count_if(bodies.begin(), bodies.end(), may_touch) ==
                      static_cast<std::ptrdiff_t>(spheres.size() + planes.size());
  const double most_speed = is_all ? kInfinity : reach[spheres.front().body] / options.time_step;
  group->spheres =
      std::make_shared<ElasticSpheres>(std::move(spheres), std::move(planes), most_speed);
  if (group->spheres->begin(states, ContactEvents::kMostOverlap)) return true;
  group->spheres.reset();
  return false;
}

// What may still be done for a group in this step: where the world chooses, all groups share.
double World::Impl::most_work_of(const ContactGroup& of) const {
  double left = few(options).work;
  if (options.method == Method::kEventDriven) return left;
  for (const ContactGroup& group : contact_groups)
    if (&group != &of && group.spheres == nullptr) left -= group.events->work();
  return std::max(left, kLeastWork);
}

void World::Impl::advance_contact_groups(const SmoothSpan& part) {
  SmoothSpan span = part;
  if (span_ends.size() == 2) span.h = options.time_step;  // a whole tick, however late it is
  for (ContactGroup& group : contact_groups) {
    if (group.has_failed) continue;
    const IntegrationResult progress =
        group.spheres != nullptr
            ? group.spheres->advance(span, &states)
            : group.events->advance(span, accuracy_within(kInfinity),
                                    joint_step(options, span.t, span.h), joint_states,
                                    most_work_of(group), &states);
    group.has_failed = !note(to_index(group.islands.front()), progress);
    if (group.islands.size() > 1)  // they exchange energy
      for (const int i : group.islands) island_parts[i].energy.has_changed = true;
    if (!group.has_failed) continue;
    for (const int i : group.islands) refuse_island(to_index(i), MethodReason::kContactsGivenUp);
  }
}

}  // namespace constraint_sim::engine
