// Islands that may touch each other, or what does not move, within a step, and are few enough to be
// carried from event to event together: between stages 2 and 3 of a step. Only with `method: auto`
// and `event_driven`. A group has no memory: it is found anew in each step, from where the bodies
// are.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "engine/constraints/contact.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/fast_bodies.h"
#include "engine/methods/contact_events.h"
#include "engine/methods/elastic_spheres.h"
#include "engine/narrowphase.h"
#include "engine/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// What a few are: in a group, and what it may cost in a step, in substeps of one with one point.
struct Few {
  std::size_t bodies, points;
  double work;
};
// Where the world chooses, groups have that work together, and each at least some of its own.
constexpr Few kAskedFor{32, 64, 2e4}, kChosen{8, 32, 1e3};
constexpr double kLeastWork = 100;

const Few& few(const WorldOptions& options) {
  return options.method == Method::kAuto ? kChosen : kAskedFor;
}

std::size_t at(int i) { return static_cast<std::size_t>(i); }

/// Whether events carry what acts of a joint beside contacts.
bool can_be_beside_contacts(const Joint& joint) {
  if (couples(joint.kind) || is_custom(joint.kind) || !is_switchable(joint)) return false;
  return !has_length(joint.kind) || length_spring(joint).is_none() || !joint.motor.is_moving();
}

/// Adds the coordinates of a joint, the last one of `equations`, on which something acts.
void add_coordinates(ContactEquations* equations) {
  const std::size_t j = equations->joints.size() - 1;
  ContactEquations::BodyJoint& of = equations->joints[j];
  const Joint& joint = of.joint;
  std::vector<OneSidedLaw> laws;
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
    const CoordinateLaw& from = joint.coordinates[at(i)];
    const auto found = std::find_if(laws.begin(), laws.end(),
                                    [&](const OneSidedLaw& law) { return law.coordinate == i; });
    OneSidedLaw law;
    if (found != laws.end()) {
      law = *found;
    } else {
      law.coordinate = i;
      law.form = kind.coordinate[at(i)];
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

/// Whether hits of a body with such ones cost nothing.
bool keeps_energy(const Body& body) {
  return body.friction == 0.0 && body.restitution == 1.0 && !body.shape_pose;
}

}  // namespace

bool World::Impl::follows_contacts() const { return engine::follows_contacts(options); }

// One that is hit gets up to twice as fast as what hits it.
void World::Impl::find_group_reach() {
  group_reach = 0.0;
  for (const int body : moving_shapes)
    group_reach = std::max(group_reach, 2.0 * travel(body, options.time_step));
  group_reach += kTouching;
}

double World::Impl::gap_of(const Broadphase::Pair& pair) const {
  const auto [a, b] = pair;
  const PlacedShape of_a(bodies[at(a)], states[at(a)]), of_b(bodies[at(b)], states[at(b)]);
  return separation(of_a.shape(), of_a.state(), of_b.shape(), of_b.state()).gap;
}

// what is easily told of it: shapes are within spheres, or on the other side of a plane
double World::Impl::least_gap(std::size_t a, std::size_t b) const {
  if (std::holds_alternative<Plane>(bodies[a].shape)) std::swap(a, b);
  const Vector3d apart = states[a].position - states[b].position;
  if (!std::holds_alternative<Plane>(bodies[b].shape))
    return apart.norm() - extent(bodies[a]) - extent(bodies[b]);
  if (bodies[b].shape_pose) return -std::numeric_limits<double>::infinity();
  return apart.dot(states[b].orientation * Vector3d::UnitZ()) - extent(bodies[a]);
}

// the gap of a pair that may touch within the step
std::optional<double> World::Impl::gap_to_watch(const Broadphase::Pair& pair) const {
  const bool both_move = is_movable(at(pair.first)) && is_movable(at(pair.second));
  const double reach = (both_move ? 2.0 : 1.0) * group_reach;
  if (least_gap(at(pair.first), at(pair.second)) > reach ||
      std::binary_search(unpaired.begin(), unpaired.end(), pair))
    return std::nullopt;
  const double gap = gap_of(pair);
  if (gap > reach) return std::nullopt;
  return gap;
}

// what sleeps and may be touched is awake
bool World::Impl::wake_approached(const std::vector<Broadphase::Pair>& near) {
  for (const Broadphase::Pair& pair : near) {
    if (!(asleep[at(pair.first)] || asleep[at(pair.second)]) || !gap_to_watch(pair)) continue;
    wake(at(pair.first));
    wake(at(pair.second));
  }
  return any_waking;
}

// Islands that pairs connect, directly or by others.
void World::Impl::find_contact_groups(const std::vector<Broadphase::Pair>& near) {
  contact_groups.clear();
  if (!follows_contacts() || near.empty()) return;
  std::vector<int>& leader = group_of;
  leader.resize(islands.size());
  std::iota(leader.begin(), leader.end(), 0);
  const auto find = [&](int i) {
    while (leader[at(i)] != i) i = leader[at(i)] = leader[at(leader[at(i)])];
    return i;
  };
  watched_pairs.clear();
  for (const Broadphase::Pair& pair : near) {
    const std::optional<double> gap = gap_to_watch(pair);
    if (!gap) continue;
    watched_pairs.push_back({pair, *gap});
    const int a = island_of[at(pair.first)], b = island_of[at(pair.second)];
    if (a >= 0 && b >= 0) leader[at(std::max(find(a), find(b)))] = std::min(find(a), find(b));
  }
  if (watched_pairs.empty()) return;
  for (int i = 0; i < static_cast<int>(islands.size()); ++i) leader[at(i)] = find(i);
  list_group_sizes();

  for (const auto& [pair, gap] : watched_pairs) {
    const int island = std::max(island_of[at(pair.first)], island_of[at(pair.second)]);
    GroupSize& size = group_sizes[at(leader[at(island)])];
    const bool is_few = size.bodies <= few(options).bodies && size.points <= few(options).points;
    if (size.overlaps || !(is_few || size.is_elastic)) continue;
    if (size.group < 0) {
      size.group = static_cast<int>(contact_groups.size());
      contact_groups.emplace_back().is_few = is_few;
    }
    contact_groups[at(size.group)].pairs.push_back(pair);
  }
  for (const int i : awake_islands) {
    const int group = group_sizes[at(leader[at(i)])].group;
    if (group >= 0) contact_groups[at(group)].islands.push_back(i);
  }
  for (ContactGroup& group : contact_groups)
    if (!compile_group(&group)) group.events.reset();
  const auto is_left = [](const ContactGroup& group) {
    return group.events == nullptr && group.spheres == nullptr;
  };
  contact_groups.erase(std::remove_if(contact_groups.begin(), contact_groups.end(), is_left),
                       contact_groups.end());
  group_of.assign(islands.size(), -1);
  for (std::size_t g = 0; g < contact_groups.size(); ++g)
    for (const int i : contact_groups[g].islands) group_of[at(i)] = static_cast<int>(g);
}

// How many there are of what could be a group, by its first island: most of what touches in a heap
// is too much, and told without a list of its own.
void World::Impl::list_group_sizes() {
  group_sizes.assign(islands.size(), GroupSize{});
  for (const auto& [pair, gap] : watched_pairs) {
    const int island = std::max(island_of[at(pair.first)], island_of[at(pair.second)]);
    GroupSize& size = group_sizes[at(group_of[at(island)])];
    size.points +=
        ContactEvents::most_points(bodies[at(pair.first)].shape, bodies[at(pair.second)].shape);
    size.overlaps = size.overlaps || gap < -ContactEvents::kMostOverlap;
  }
  for (const int i : awake_islands) {
    GroupSize& size = group_sizes[at(group_of[at(i)])];
    const std::vector<int>& members = island_parts[at(i)].members.bodies;
    size.bodies += members.size();
    size.is_elastic =
        size.is_elastic && members.size() == 1 && is_elastic_sphere(at(members.front()));
  }
}

// who is in a group, as islands were sorted
void World::Impl::list_grouped_bodies() {
  grouped_bodies.clear();
  for (const int i : awake_islands)
    if (islands[at(i)].why == MethodReason::kFewContacts)
      for (const int body : island_parts[at(i)].members.bodies)
        grouped_bodies.push_back(body_ids[at(body)]);
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
                     [&](int j) { return can_be_beside_contacts(joints[at(j)]); });
}

// Whether all that an island has can be in a group.
bool World::Impl::can_be_in_group(std::size_t i) const {
  const IslandParts& parts = island_parts[i];
  if (!suits_group(parts.members, parts.nature, parts)) return false;
  const JointStep now = span_from(time(), options.time_step);
  return std::all_of(parts.members.joints.begin(), parts.members.joints.end(), [&](int index) {
    const std::size_t j = at(index);
    JointState state = joint_states[j];
    return !state.closing && !is_moving_by_itself(joint_ends[j].first) &&
           !is_moving_by_itself(joint_ends[j].second) &&
           (!is_rigid(joints[j]) || fits(joints[j], state_a(j), state_b(j), now, state));
  });
}

// The group with its equations; false where it is left to others.
bool World::Impl::compile_group(ContactGroup* group) {
  if (compile_spheres(group)) return true;
  if (!group->is_few) return false;
  ContactEquations equations;
  std::vector<int> place(bodies.size(), -1);
  const auto add = [&](int body) {
    if (place[at(body)] >= 0) return;
    place[at(body)] = static_cast<int>(equations.bodies.size());
    ContactEquations::Body& added = equations.bodies.emplace_back();
    added.index = body;
    added.mass = masses[at(body)];
  };
  for (const int i : group->islands) {
    if (!can_be_in_group(at(i))) return false;
    for (const int body : island_parts[at(i)].members.bodies) add(body);
  }
  equations.movable = equations.bodies.size();
  for (const int i : group->islands) {
    for (const int index : island_parts[at(i)].members.joints) {
      const auto [a, b] = joint_ends[at(index)];
      add(static_cast<int>(a));
      add(static_cast<int>(b));
      ContactEquations::BodyJoint& joint = equations.joints.emplace_back();
      joint.index = index;
      joint.a = at(place[a]);
      joint.b = at(place[b]);
      joint.joint = joints[at(index)];
      add_coordinates(&equations);
    }
  }
  if (equations.coordinates.size() > ContactEvents::kMostLaws) return false;
  std::vector<ContactEvents::Pair> pairs;
  for (auto [a, b] : group->pairs) {
    if (is_moving_by_itself(at(a)) || is_moving_by_itself(at(b))) return false;
    if (!has_features(bodies[at(a)].shape, bodies[at(b)].shape)) std::swap(a, b);
    const Body& body_a = bodies[at(a)];
    const Body& body_b = bodies[at(b)];
    if (!has_features(body_a.shape, body_b.shape)) return false;
    if (body_a.shape_pose || body_b.shape_pose) return false;
    add(a);
    add(b);
    const ContactSurface surface(body_a, body_b);
    pairs.push_back({at(place[at(a)]), at(place[at(b)]), body_a.shape, body_b.shape,
                     surface.friction, surface.restitution, 0, 0,
                     std::min(thickness(body_a.shape), thickness(body_b.shape))});
  }
  group->events = std::make_shared<ContactEvents>(std::move(equations), std::move(pairs));
  return group->events->begin(states);
}

bool World::Impl::is_elastic_sphere(std::size_t body) const {
  const Vector3d& inertia = masses[body].inertia;
  return std::holds_alternative<Sphere>(bodies[body].shape) && keeps_energy(bodies[body]) &&
         inertia.x() == inertia.y() && inertia.y() == inertia.z();
}

// The same of any number of spheres that keep all energy, on planes.
bool World::Impl::compile_spheres(ContactGroup* group) {
  std::vector<ElasticSpheres::Sphere> spheres;
  for (const int i : group->islands) {
    const IslandMembers& members = island_parts[at(i)].members;
    if (!can_be_in_group(at(i)) || members.bodies.size() != 1 || !members.joints.empty())
      return false;
    const int body = members.bodies.front();
    if (!is_elastic_sphere(at(body))) return false;
    const auto is_on_it = [&](const Wrench& wrench) { return wrench.body == body_ids[at(body)]; };
    if (std::any_of(wrenches.begin(), wrenches.end(), is_on_it)) return false;
    spheres.push_back({body, 1.0 / masses[at(body)].inverse_mass,
                       std::get<Sphere>(bodies[at(body)].shape).radius});
  }
  std::vector<ElasticSpheres::Plane> planes;
  std::vector<int> others;
  for (const auto& [a, b] : group->pairs)
    for (const int body : {a, b})
      if (!is_movable(at(body))) others.push_back(body);
  std::sort(others.begin(), others.end());
  others.erase(std::unique(others.begin(), others.end()), others.end());
  for (const int body : others) {
    if (is_moving_by_itself(at(body)) || !keeps_energy(bodies[at(body)]) ||
        !std::holds_alternative<Plane>(bodies[at(body)].shape))
      return false;
    const BodyState& state = states[at(body)];
    planes.push_back({body, state.orientation * Vector3d::UnitZ(), state.position});
  }
  // where all that can touch is among them, they can meet nothing else however fast they get
  const auto can_touch = [](const Body& body) {
    return !body.no_collision && !std::holds_alternative<Point>(body.shape);
  };
  const bool is_all = std::count_if(bodies.begin(), bodies.end(), can_touch) ==
                      static_cast<std::ptrdiff_t>(spheres.size() + planes.size());
  const double most_speed =
      is_all ? std::numeric_limits<double>::infinity() : group_reach / options.time_step;
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
    if (&group != &of && group.events != nullptr) left -= group.events->work();
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
            : group.events->advance(span, accuracy_within(std::numeric_limits<double>::infinity()),
                                    span_from(span.t, span.h), joint_states, most_work_of(group),
                                    &states);
    group.has_failed = !note(at(group.islands.front()), progress);
    if (group.islands.size() > 1)  // they exchange energy
      for (const int i : group.islands) island_parts[at(i)].energy.has_changed = true;
    if (!group.has_failed) continue;
    for (const int i : group.islands) refuse_island(at(i), MethodReason::kContactsGivenUp);
  }
}

}  // namespace constraint_sim::engine
