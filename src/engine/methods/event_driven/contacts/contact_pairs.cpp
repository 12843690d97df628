#include "engine/methods/event_driven/contacts/contact_pairs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "engine/collision/box_features.h"
#include "engine/collision/narrowphase.h"
#include "engine/model/shape_pair.h"

namespace constraint_sim::engine {
namespace {

constexpr std::uint32_t kTaken = std::numeric_limits<std::uint32_t>::max();
// Rotation of a box in a substep [rad]: the gap of a corner at the distance r from the centre is
// then within 3.4e-7 r of its interpolant, r θ⁶/46080.
constexpr double kMostBoxTurn = 0.5;

double gap_of_boxes(const ContactEquations& equations, const ContactPair& pair) {
  const GroupBodies& bodies = equations.bodies();
  return separation_of_boxes(
             std::get<Box>(pair.shape_a).size, bodies.shape_state(pair.shape_index_a),
             std::get<Box>(pair.shape_b).size, bodies.shape_state(pair.shape_index_b))
      .gap;
}

// Size that tolerances of the contacts of a pair assume [m].
double size_of_pair(const ContactEquations& equations, const ContactPair& pair) {
  const GroupBodies& bodies = equations.bodies();
  double distance = 0.0;
  for (const std::size_t shape : {pair.shape_index_a, pair.shape_index_b})
    if (bodies.shapes()[shape].body < bodies.movable())
      distance = std::max(distance, bodies.shape_state(shape).position.norm());
  return size_of_contact(pair.shape_a, pair.shape_b, distance);
}

constexpr std::size_t kPointsOfLine = 2, kPointsOfFace = 8;

/// Largest number of points at which a shape touches another one: one per sphere, both ends of a
/// line, or the corners of the common area of two faces.
struct MostPoints {
  std::size_t operator()(const Point&) const { return kPointsOfFace; }
  std::size_t operator()(const Sphere&) const { return 1; }
  std::size_t operator()(const Box&) const { return kPointsOfFace; }
  std::size_t operator()(const Plane&) const { return kPointsOfFace; }
  std::size_t operator()(const Cylinder&) const { return kPointsOfFace; }
  std::size_t operator()(const Hull&) const { return kPointsOfFace; }
  std::size_t operator()(const Capsule&) const { return kPointsOfLine; }
  std::size_t operator()(const Compound&) const { return kPointsOfFace; }
};

// Keeps known edge features in their places in the list of contacts.
void keep_places(const ContactEquations& equations, const ContactPair& pair, bool all,
                 List<ContactFeature>* found) {
  std::array<ContactFeature, kBoxEdges> edges;
  std::array<char, kBoxEdges> is_free;
  std::copy(found->begin() + kBoxCorners, found->end(), edges.begin());
  is_free.fill(1);
  for (std::size_t k = 0; k < edges.size(); ++k) {
    const ContactEquations::Contact& contact = equations.contacts()[pair.first + kBoxCorners + k];
    if (contact.feature.kind == ContactFeature::Kind::kNothing) continue;
    auto* const same = std::find_if(edges.begin(), edges.end(), [&](const ContactFeature& edge) {
      return edge.id == contact.feature.id;
    });
    if (same == edges.end() && (all || contact.acts == ContactEquations::Acts::kOpen)) continue;
    is_free[k] = 0;
    (*found)[kBoxCorners + k] = contact.feature;
    if (same == edges.end()) continue;
    (*found)[kBoxCorners + k] = *same;
    same->id = kTaken;
  }
  auto* next = edges.begin();
  for (std::size_t k = 0; k < edges.size(); ++k) {
    if (!is_free[k]) continue;
    while (next != edges.end() && next->id == kTaken) ++next;
    ContactFeature& place = (*found)[kBoxCorners + k];
    place = {};
    place.kind = ContactFeature::Kind::kNothing;
    if (next != edges.end()) place = *next++;
  }
}

}  // namespace

std::size_t ContactPairs::most_points(const Shape& a, const Shape& b) {
  const std::size_t of_a = std::visit(MostPoints{}, a), of_b = std::visit(MostPoints{}, b);
  // A capsule counts with two points against spheres too, an upper bound.
  const bool is_any_line = of_a == kPointsOfLine || of_b == kPointsOfLine;
  return is_any_line ? kPointsOfLine : std::min(of_a, of_b);
}

void ContactPairs::add_contacts(ContactEquations* equations) {
  const GroupBodies& bodies = equations->bodies();
  equations->contacts().clear();
  pair_of_.clear();
  List<ContactFeature>& found = found_;
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    ContactPair& pair = pairs_[p];
    found.clear();
    add_features(pair.shape_a, bodies.shape_state(pair.shape_index_a), pair.shape_b,
                 bodies.shape_state(pair.shape_index_b), tolerances_, &found);
    pair.first = equations->contacts().size();
    pair.count = found.size();
    for (const ContactFeature& feature : found) {
      ContactEquations::Contact& contact = equations->contacts().emplace_back();
      contact.a = pair.a;
      contact.b = pair.b;
      contact.shape_index_a = pair.shape_index_a;
      contact.shape_index_b = pair.shape_index_b;
      contact.friction = pair.friction;
      contact.restitution = pair.restitution;
      contact.feature = feature;
      pair_of_.push_back(p);
    }
  }
}

bool ContactPairs::begin(bool closes, ContactEquations* equations) {
  double smallest = kInfinity;
  for (const ContactPair& pair : pairs_)
    smallest = std::min(smallest, size_of_pair(*equations, pair));
  tolerances_ = ContactTolerances(smallest);
  const auto is_too_deep = [&](std::size_t p, double depth) {
    return !closes && depth > 0.0 &&
           depth > ContactTolerances(size_of_pair(*equations, pairs_[p])).overlap;
  };
  add_contacts(equations);
  depths_.at_start.assign(pairs_.size(), 0.0);
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    pairs_[p].is_still = false;
    if (pairs_[p].is_of_boxes()) depths_.at_start[p] = -gap_of_boxes(*equations, pairs_[p]);
    if (is_too_deep(p, depths_.at_start[p])) return false;
  }
  for (std::size_t c = 0; c < equations->contacts().size(); ++c) {
    const ContactMotion now = equations->motion(equations->contacts()[c]);
    const std::size_t p = pair_of_[c];
    if (is_too_deep(p, -now.gap)) return false;
    depths_.at_start[p] = std::max(depths_.at_start[p], -now.gap);
    note_step_before(now, &pairs_[p]);
  }
  for (ContactPair& pair : pairs_) pair.stuck = pair.stuck && pair.is_still;
  return true;
}

// Infers how a pair acted at the end of the previous step, as far as the motion of a contact shows
// it.
void ContactPairs::note_step_before(const ContactMotion& now, ContactPair* pair) const {
  if (!pair->touched || now.gap > tolerances_.touching ||
      std::abs(now.gap_rate()) > tolerances_.resting)
    return;
  pair->held = true;
  pair->is_still = pair->is_still || now.slip().norm() <= tolerances_.resting;
}

void ContactPairs::find_features(bool all, bool is_within, ContactEquations* equations) {
  const GroupBodies& bodies = equations->bodies();
  List<ContactFeature>& found = found_;
  for (const ContactPair& pair : pairs_) {
    if (pair.has_fixed_features() || (is_within && pair.is_of_boxes())) continue;
    found.clear();
    add_features(pair.shape_a, bodies.shape_state(pair.shape_index_a), pair.shape_b,
                 bodies.shape_state(pair.shape_index_b), tolerances_, &found);
    if (pair.is_of_boxes()) keep_places(*equations, pair, all, &found);
    for (std::size_t k = 0; k < pair.count; ++k) {
      ContactEquations::Contact& contact = equations->contacts()[pair.first + k];
      if (all || contact.acts == ContactEquations::Acts::kOpen) contact.feature = found[k];
    }
  }
}

bool ContactPairs::has_missed(const ContactEquations& equations) {
  bool any = false;
  List<double>& depth = depths_.at_end;
  depth = depths_.at_start;
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    const ContactPair& pair = pairs_[p];
    depth[p] = 0.0;
    if (!pair.is_of_boxes()) {
      for (std::size_t c = pair.first; c < pair.first + pair.count; ++c)
        depth[p] = std::max(depth[p], -equations.motion(equations.contacts()[c]).gap);
      any = any || depth[p] > std::max(tolerances_.missed, depths_.at_start[p]);
      continue;
    }
    // Features of only one box: a face separates the boxes.
    const auto is_nothing = [&](std::size_t k) {
      return equations.contacts()[pair.first + k].feature.kind == ContactFeature::Kind::kNothing;
    };
    if (is_nothing(0) != is_nothing(8)) continue;
    depth[p] = -gap_of_boxes(equations, pair);
    any = any || depth[p] > std::max(tolerances_.missed, depths_.at_start[p]);
  }
  if (!any) depths_.at_start = depth;
  return any;
}

double ContactPairs::longest_substep(double left, const ContactEquations& equations) const {
  const GroupBodies& bodies = equations.bodies();
  double longest = left;
  const double fall = left * bodies.gravity().norm();
  for (std::size_t c = 0; c < equations.contacts().size(); ++c) {
    const ContactEquations::Contact& contact = equations.contacts()[c];
    const ContactPair& pair = of(c);
    if (contact.acts != ContactEquations::Acts::kOpen ||
        contact.feature.kind == ContactFeature::Kind::kNothing)
      continue;
    if (!contact.feature.on_a.isZero(0.0) || bodies.shapes().is_beside(contact.shape_index_a))
      longest = std::min(longest, kMostBoxTurn / bodies.state(contact.a).angular_velocity.norm());
    if (pair.is_of_boxes() || bodies.shapes().is_beside(contact.shape_index_b))
      longest = std::min(longest, kMostBoxTurn / bodies.state(contact.b).angular_velocity.norm());
    // Behind a plane the gap stays negative, so no hit is passed over.
    if (!std::isfinite(pair.thickness) || std::holds_alternative<Plane>(pair.shape_b)) continue;
    const ContactMotion now = equations.motion(contact);
    const double allowed = std::max(now.gap, kFastShare * pair.thickness);
    longest = std::min(longest, allowed / std::max(now.w.norm() + fall, pair.assumed_speed));
  }
  return longest;
}

}  // namespace constraint_sim::engine
