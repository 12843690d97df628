// What groups of contacts by events did in a step, told to joints, contacts and the list of events.

#include <algorithm>
#include <map>

#include "engine/collision/narrowphase.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/runge_kutta/elastic_spheres.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

ContactState state_of(const ContactEquations::Contact& contact) {
  if (contact.acts == ContactEquations::Acts::kOpen || contact.friction == 0.0)
    return ContactState::kClosed;
  return contact.acts == ContactEquations::Acts::kSlips ? ContactState::kSlipping
                                                        : ContactState::kSticking;
}

/// Where an impulse goes to of those told: to the same point, or where there are as many as there
/// can be, to the nearest one; else to one of its own.
std::size_t place_of(const Vector3d& position, const TouchingPair& pair) {
  constexpr double kSame = 1e-9;  // [m]
  const auto count = to_index(pair.manifold.count);
  std::size_t nearest = count;
  double distance = count < pair.manifold.points.size() ? kSame : HUGE_VAL;
  for (std::size_t k = 0; k < count; ++k) {
    const double away = (pair.manifold.points[k].position - position).norm();
    if (!(away < distance)) continue;
    distance = away;
    nearest = k;
  }
  return nearest;
}

/// Contacts of a pair that hold, or had an impulse within the step, in the order of bodies.
TouchingPair contacts_of(const ContactEvents& by_events, const ContactEvents::Pair& of) {
  const ContactEquations& equations = by_events.equations();
  const int a = equations.bodies[of.a].index, b = equations.bodies[of.b].index;
  const bool is_swapped = a > b;
  TouchingPair pair;
  pair.a = std::min(a, b);
  pair.b = std::max(a, b);
  const double sign = is_swapped ? -1.0 : 1.0;
  for (const bool acts : {true, false}) {  // those that act now first
    for (std::size_t c = of.first; c < of.first + of.count; ++c) {
      const ContactEquations::Contact& contact = equations.contacts[c];
      if (!by_events.has_touched(c) || acts != (contact.acts != ContactEquations::Acts::kOpen))
        continue;
      const bool has_moved_on = !acts && of.is_of_boxes();  // to other features
      const ContactFeature& feature = has_moved_on ? contact.touched : contact.feature;
      const ContactMotion now = equations.motion(contact, feature);
      const Vector3d position = is_swapped ? now.p : Vector3d(now.p - now.gap * now.n);
      const std::size_t k =
          of.is_of_boxes() ? place_of(position, pair) : to_index(pair.manifold.count);
      if (k < to_index(pair.manifold.count)) {
        pair.impulses[k] += sign * contact.impulse;
        continue;
      }
      ++pair.manifold.count;
      pair.manifold.normal = sign * now.n;
      pair.manifold.points[k] = {position, has_moved_on ? 0.0 : std::max(-now.gap, 0.0),
                                 feature.id};
      pair.impulses[k] = sign * contact.impulse;
      pair.contact_states[k] = state_of(contact);
    }
  }
  return pair;
}

}  // namespace

// Their contacts are not those of impulses.
void World::Impl::take_out_group_contacts() {
  const auto is_of_group = [&](const TouchingPair& pair) {
    const int island = std::max(topology.island_of(pair.a), topology.island_of(pair.b));
    return is_in_group(to_index(island)) && !contact_groups[group_of[island]].has_failed;
  };
  touching.erase(std::remove_if(touching.begin(), touching.end(), is_of_group), touching.end());
}

// What groups did, to joints, contacts and the list of events.
void World::Impl::tell_contact_groups(const JointStep& step) {
  for (const ContactGroup& group : contact_groups) {
    if (group.has_failed) continue;
    if (group.spheres != nullptr) {
      tell_spheres(*group.spheres);
      continue;
    }
    const ContactEvents& by_events = *group.events.get();
    const ContactEquations& equations = by_events.equations();
    const auto joint_of = [&](std::size_t coordinate) {
      return to_index(equations.joints[equations.coordinates[coordinate].joint].index);
    };
    const auto body_of = [&](std::size_t place) { return equations.bodies[place].index; };
    for (const ContactEvents::Told& told : by_events.told()) {
      const double t = std::min(told.time, span_ends.back());  // to rounding after the tick
      if (told.joint >= 0) {
        const std::size_t j = to_index(equations.joints[told.joint].index);
        events.push_back({told.kind, t, joints[j].body_a, joints[j].body_b, joint_ids[j]});
        continue;
      }
      if (told.pair < 0) {
        const std::size_t j = joint_of(to_index(told.coordinate));
        const OneSidedLaw& law = equations.coordinates[told.coordinate].law;
        events.push_back({told.kind, t, joints[j].body_a, joints[j].body_b, joint_ids[j],
                          law.is_distance ? -1 : law.coordinate, told.impulse});
        continue;
      }
      const ContactEvents::Pair& pair = by_events.pairs()[told.pair];
      events.push_back({told.kind, t, body_ids[body_of(pair.a)], body_ids[body_of(pair.b)],
                        std::nullopt, -1, told.impulse});
    }
    for (std::size_t c = 0; c < equations.coordinates.size(); ++c)
      by_events.write(c, &joint_states[joint_of(c)]);
    for (const ContactEquations::BodyJoint& joint : equations.joints) {
      if (joint.is_broken) joint_states[joint.index].broken = true;
      read_smooth_joint(to_index(joint.index), step, joint.impulse, 0.0);
    }
    add_group_contacts(by_events);
  }
  std::sort(touching.begin(), touching.end(),
            [](const TouchingPair& l, const TouchingPair& r) { return l.ends() < r.ends(); });
}

void World::Impl::add_group_contacts(const ContactEvents& by_events) {
  for (const ContactEvents::Pair& of : by_events.pairs()) {
    const TouchingPair pair = contacts_of(by_events, of);
    if (pair.manifold.count > 0) add_group_contact(pair);
  }
}

void World::Impl::add_group_contact(TouchingPair pair) {
  pair.id_a = body_ids[pair.a];
  pair.id_b = body_ids[pair.b];
  report.contacts += static_cast<std::uint32_t>(pair.manifold.count);
  for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k)
    report.max_penetration = std::max(report.max_penetration, pair.manifold.points[k].depth);
  touching.push_back(pair);
}

// each pair that has hit once, with all its impulses
void World::Impl::tell_spheres(const ElasticSpheres& spheres) {
  std::map<std::pair<int, int>, Vector3d> impulses;  // on the first
  for (const ElasticSpheres::Hit& hit : spheres.hits()) {
    const int a = std::min(hit.a, hit.b), b = std::max(hit.a, hit.b);
    Vector3d& sum = impulses.emplace(std::pair(a, b), Vector3d::Zero()).first->second;
    sum += hit.a == a ? hit.impulse : Vector3d(-hit.impulse);
    const double size = hit.impulse.norm();
    events.push_back(
        {EventKind::kContactBegan, hit.time, body_ids[a], body_ids[b], std::nullopt, -1, size});
    events.push_back(
        {EventKind::kContactEnded, hit.time, body_ids[a], body_ids[b], std::nullopt, -1, 0.0});
  }
  for (const auto& [ends, impulse] : impulses) {
    TouchingPair pair;
    pair.a = ends.first;
    pair.b = ends.second;
    const PlacedShape a(bodies[pair.a], states[pair.a]), b(bodies[pair.b], states[pair.b]);
    const Separation now = separation(a.shape(), a.state(), b.shape(), b.state());
    const auto* of_a = std::get_if<Sphere>(&bodies[pair.a].shape);
    const auto* of_b = std::get_if<Sphere>(&bodies[pair.b].shape);
    pair.manifold.count = 1;
    pair.manifold.normal = now.normal;
    pair.manifold.points[0] = {
        of_b != nullptr ? Vector3d(b.state().position + of_b->radius * now.normal)
                        : Vector3d(a.state().position - (of_a->radius + now.gap) * now.normal),
        std::max(-now.gap, 0.0), 0};
    pair.impulses[0] = impulse;
    pair.contact_states[0] = ContactState::kClosed;
    add_group_contact(pair);
  }
}

// the first one tells those of all
std::uint32_t World::Impl::events_of_group(std::size_t island) const {
  const ContactGroup& group = contact_groups[group_of[island]];
  if (group.islands.front() != static_cast<int>(island)) return 0;
  return group.spheres != nullptr ? static_cast<std::uint32_t>(group.spheres->hits().size())
                                  : group.events->events();
}

// the same of what moves by itself and touches them
double World::Impl::driven_work_of_group(std::size_t island) const {
  const ContactGroup& group = contact_groups[group_of[island]];
  if (group.islands.front() != static_cast<int>(island) || group.spheres != nullptr) return 0.0;
  return group.events->driven_work();
}

}  // namespace constraint_sim::engine
