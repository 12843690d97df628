#include "engine/islands/contact_group_reports.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "engine/collision/narrowphase.h"
#include "engine/collision/placed_shape.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/runge_kutta/elastic_spheres.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

ContactState state_of(const ContactEquations::Contact& contact) {
  if (contact.acts == ContactEquations::Acts::kOpen || contact.friction == 0.0)
    return ContactState::kClosed;
  return contact.acts == ContactEquations::Acts::kSlips ? ContactState::kSlipping
                                                        : ContactState::kSticking;
}

/// Index of the point that an impulse is added to: of the same point, or where a pair has no room
/// for more points, of the nearest point; else of a new point.
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
TouchingPair contacts_of(const ContactEquations& equations, const ContactPair& of) {
  const GroupBodies& bodies = equations.bodies();
  TouchingPair pair;
  pair.a = bodies[of.a].index;
  pair.b = bodies[of.b].index;
  pair.part_a = bodies.shapes()[of.shape_index_a].part;
  pair.part_b = bodies.shapes()[of.shape_index_b].part;
  const bool is_swapped = pair.a > pair.b;
  if (is_swapped) {
    std::swap(pair.a, pair.b);
    std::swap(pair.part_a, pair.part_b);
  }
  const double sign = is_swapped ? -1.0 : 1.0;
  for (const bool acts : {true, false}) {  // contacts that act now come first
    for (std::size_t c = of.first; c < of.first + of.count; ++c) {
      const ContactEquations::Contact& contact = equations.contacts()[c];
      if (!contact.has_touched() || acts != (contact.acts != ContactEquations::Acts::kOpen))
        continue;
      const bool has_moved_on = !acts && of.is_of_boxes();  // to other features
      const ContactFeature& feature = has_moved_on ? contact.touched : contact.feature;
      const ContactMotion now = bodies.motion(of.shape_index_a, of.shape_index_b, feature);
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

/// Adds the contacts of spheres: each pair that has hit once, with the sum of its impulses.
void add_sphere_contacts(const Model& model, const List<BodyState>& states,
                         const ElasticSpheres& spheres, List<TouchingPair>* touching) {
  std::map<std::pair<int, int>, Vector3d> impulses;  // on the first body
  for (const ElasticSpheres::Hit& hit : spheres.hits()) {
    const int a = std::min(hit.a, hit.b), b = std::max(hit.a, hit.b);
    Vector3d& sum = impulses.emplace(std::pair(a, b), Vector3d::Zero()).first->second;
    sum += hit.a == a ? hit.impulse : Vector3d(-hit.impulse);
  }
  for (const auto& [ends, impulse] : impulses) {
    TouchingPair pair;
    pair.a = ends.first;
    pair.b = ends.second;
    const PlacedShape a(model.bodies[pair.a], 0, states[pair.a]),
        b(model.bodies[pair.b], 0, states[pair.b]);
    const Separation now = separation(a.shape(), a.state(), b.shape(), b.state());
    const auto* of_a = std::get_if<Sphere>(&model.bodies[pair.a].shape);
    const auto* of_b = std::get_if<Sphere>(&model.bodies[pair.b].shape);
    pair.manifold.count = 1;
    pair.manifold.normal = now.normal;
    pair.manifold.points[0] = {
        of_b != nullptr ? Vector3d(b.state().position + of_b->radius * now.normal)
                        : Vector3d(a.state().position - (of_a->radius + now.gap) * now.normal),
        std::max(-now.gap, 0.0), 0};
    pair.impulses[0] = impulse;
    pair.contact_states[0] = ContactState::kClosed;
    touching->push_back(pair);
  }
}

}  // namespace

void add_group_events(const Model& model, const ContactGroup& group, double end,
                      std::vector<Event>* events) {
  if (group.spheres != nullptr) {
    for (const ElasticSpheres::Hit& hit : group.spheres->hits()) {
      const BodyId a = model.body_ids[std::min(hit.a, hit.b)],
                   b = model.body_ids[std::max(hit.a, hit.b)];
      const double size = hit.impulse.norm();
      events->push_back({EventKind::kContactBegan, hit.time, a, b, std::nullopt, -1, size});
      events->push_back({EventKind::kContactEnded, hit.time, a, b, std::nullopt, -1, 0.0});
    }
    return;
  }
  const ContactEvents& by_events = *group.events.get();
  const GroupBodies& bodies = by_events.equations().bodies();
  const GroupJoints& joints = by_events.equations().joints();
  const auto joint_of = [&](std::size_t coordinate) {
    return to_index(joints[joints.coordinates()[coordinate].joint].index);
  };
  const auto body_of = [&](std::size_t place) { return bodies[place].index; };
  for (const ContactReports::Report& report : by_events.reports().list()) {
    const double t = std::min(report.time, end);  // by rounding after the end of the step
    if (report.joint >= 0) {
      const std::size_t j = to_index(joints[report.joint].index);
      events->push_back(
          {report.kind, t, model.joints[j].body_a, model.joints[j].body_b, model.joint_ids[j]});
      continue;
    }
    if (report.pair < 0) {
      const std::size_t j = joint_of(to_index(report.coordinate));
      const OneSidedLaw& law = joints.coordinates()[report.coordinate].law;
      events->push_back({report.kind, t, model.joints[j].body_a, model.joints[j].body_b,
                         model.joint_ids[j], law.is_rope() ? -1 : law.coordinate, report.impulse});
      continue;
    }
    const ContactPair& pair = by_events.pairs()[report.pair];
    events->push_back({report.kind, t, model.body_ids[body_of(pair.a)],
                       model.body_ids[body_of(pair.b)], std::nullopt, -1, report.impulse});
  }
}

void add_group_contacts(const Model& model, const List<BodyState>& states,
                        const ContactGroup& group, List<TouchingPair>* touching) {
  const std::size_t first = touching->size();
  if (group.spheres != nullptr) {
    add_sphere_contacts(model, states, *group.spheres, touching);
  } else {
    for (const ContactPair& of : group.events->pairs()) {
      const TouchingPair pair = contacts_of(group.events->equations(), of);
      if (pair.manifold.count > 0) touching->push_back(pair);
    }
  }
  for (std::size_t k = first; k < touching->size(); ++k) {
    TouchingPair& pair = (*touching)[k];
    pair.id_a = model.body_ids[pair.a];
    pair.id_b = model.body_ids[pair.b];
  }
}

}  // namespace constraint_sim::engine
