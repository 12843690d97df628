#include "engine/islands/motion_bounds.h"

#include <algorithm>

#include "engine/collision/convex.h"
#include "engine/collision/placed_shape.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/impulse_method.h"
#include "engine/model/shape_properties.h"

namespace constraint_sim::engine {
namespace {

struct Thickness {
  double operator()(const Point&) const { return kInfinity; }
  double operator()(const Sphere& sphere) const { return 2.0 * sphere.radius; }
  double operator()(const Box& box) const { return box.size.minCoeff(); }
  double operator()(const Plane&) const { return kInfinity; }
  double operator()(const Cylinder& cylinder) const {
    return std::min(2.0 * cylinder.radius, cylinder.length);
  }
  double operator()(const Hull& hull) const { return hull.surface->thickness(); }
  double operator()(const Capsule& capsule) const { return 2.0 * capsule.radius; }
};

/// Distance from its centre within which rotation moves a shape [m]: the bounding radius, except
/// for a sphere, which rotates in its place, and a plane, of which only the part within `distance`
/// counts.
struct SwingRadius : BoundingRadius {
  explicit SwingRadius(double distance) : distance(distance) {}
  using BoundingRadius::operator();
  double operator()(const Sphere&) const { return 0.0; }
  double operator()(const Plane&) const { return distance; }

  double distance;
};

/// Largest distance from the centre of a body within which rotation moves a part [m]. Out of line,
/// so that bodies of one shape pay nothing for it.
[[gnu::noinline]] double farthest_swing(const Compound& compound, double distance) {
  double most = 0.0;
  for (const ShapePart& part : *compound.parts)
    most =
        std::max(most, visit_convex(SwingRadius(distance), part.shape) + part.pose.position.norm());
  return most;
}

double arm_of_shape(const Body& body) {
  return body.shape_pose ? body.shape_pose->position.norm() : 0.0;
}

const Shape& shape_of(const Model& model, int body, int part) {
  return part_of(model.bodies[body].shape, part);
}

}  // namespace

bool may_touch(const Body& body) { return !body.no_collision && has_surface(body.shape); }

bool may_collide(const Body& a, const Body& b) {
  return !a.no_collision && !b.no_collision &&
         share_a_group(a.collision_groups, a.collision_mask, b.collision_groups, b.collision_mask);
}

bool collides_with_all(const Body& body) {
  return body.collision_groups == 1 && body.collision_mask == kAllGroups;
}

double thickness(const Shape& shape) {
  const auto* compound = std::get_if<Compound>(&shape);
  if (compound == nullptr) return visit_convex(Thickness{}, shape);
  double least = kInfinity;
  for (const ShapePart& part : *compound->parts)
    least = std::min(least, visit_convex(Thickness{}, part.shape));
  return least;
}

double swing_radius(const Body& body, double distance) {
  if (const auto* compound = std::get_if<Compound>(&body.shape))
    return farthest_swing(*compound, distance);
  return visit_convex(SwingRadius(distance), body.shape) + arm_of_shape(body);
}

bool is_centred(const Body& body) {
  return !body.shape_pose && !std::holds_alternative<Compound>(body.shape);
}

double extent(const Body& body) { return bounding_radius(body.shape) + arm_of_shape(body); }

double thinner_of(const Model& model, const ShapePair& pair) {
  const Thickness thickness;
  return std::min(visit_convex(thickness, shape_of(model, pair.first, pair.part_first)),
                  visit_convex(thickness, shape_of(model, pair.second, pair.part_second)));
}

ContactTolerances tolerances_of(const Model& model, const State& state, const ShapePair& pair) {
  double distance = 0.0;
  for (const int body : {pair.first, pair.second})
    if (model.is_movable(to_index(body)))
      distance = std::max(distance, state.states[body].position.norm());
  return ContactTolerances(size_of_contact(shape_of(model, pair.first, pair.part_first),
                                           shape_of(model, pair.second, pair.part_second),
                                           distance));
}

double max_center_displacement(const StepContext& step, const BodyState& now, int body,
                               double duration) {
  const Model& model = step.model;
  const double fall =
      model.is_movable(to_index(body)) ? duration * model.options.gravity.norm() : 0.0;
  const double known = duration * (now.linear_velocity.norm() + fall);
  if (!step.assumed.has_longer_paths()) return known;
  return std::max(known, duration / model.options.time_step * step.assumed.of(body));
}

double max_point_displacement(const StepContext& step, const BodyState& now, int body,
                              double duration) {
  const double of_center = max_center_displacement(step, now, body, duration);
  const double turning = now.angular_velocity.norm();
  if (turning == 0.0) return of_center;  // planes reach to infinity
  return of_center + duration * turning * swing_radius(step.model.bodies[body]);
}

double max_distance(const StepContext& step, const BodyState& now, int body, double duration) {
  return std::min(
      max_point_displacement(step, now, body, duration),
      max_center_displacement(step, now, body, duration) + swing_radius(step.model.bodies[body]));
}

double displacement_with_fall(const WorldOptions& options, const BodyState& body, double duration) {
  return duration * (body.linear_velocity.norm() + duration * options.gravity.norm());
}

double contact_margin(const StepContext& step, const State& state, const ShapePair& pair,
                      double duration) {
  const auto displacement = [&](int body) {
    const BodyState& now = state.states[body];
    return controls_contacts(step.model.options)
               ? max_point_displacement(step, now, body, duration)
               : displacement_with_fall(step.model.options, now, duration);
  };
  return std::min(displacement(pair.first) + displacement(pair.second),
                  kMarginShare * thinner_of(step.model, pair));
}

double fast_share(const WorldOptions& options) {
  return controls_contacts(options) ? kMarginShare : kFastShare;
}

void add_proxies(const Model& model, const BodyState& at, int body, double margin,
                 List<Proxy>* proxies) {
  const Body& of = model.bodies[body];
  const auto wide = Eigen::Vector3d::Constant(margin);
  const int parts = static_cast<int>(part_count(of.shape));
  for (int part = 0; part < parts; ++part) {
    const PlacedShape placed(of, part, at);
    const Aabb box = bounds(placed.shape(), placed.state());
    proxies->push_back({{box.min - wide, box.max + wide},
                        body,
                        model.is_movable(to_index(body)),
                        static_cast<std::uint16_t>(part),
                        of.collision_groups,
                        of.collision_mask});
  }
}

bool is_fast(const StepContext& step, const State& state, const ShapePair& pair, double duration) {
  const int a = pair.first, b = pair.second;
  return max_point_displacement(step, state.states[a], a, duration) +
             max_point_displacement(step, state.states[b], b, duration) >
         fast_share(step.model.options) * thinner_of(step.model, pair);
}

Manifold collide(const Model& model, const State& state, const ShapePair& pair, double margin) {
  const int a = pair.first, b = pair.second;
  return collide(PlacedShape(model.bodies[a], pair.part_first, state.states[a]),
                 PlacedShape(model.bodies[b], pair.part_second, state.states[b]), margin);
}

Separation separation_of(const Model& model, const ShapePair& pair, const BodyState& first,
                         const BodyState& second) {
  const PlacedShape a(model.bodies[pair.first], pair.part_first, first),
      b(model.bodies[pair.second], pair.part_second, second);
  return separation(a.shape(), a.state(), b.shape(), b.state());
}

Separation separation_of(const Model& model, const State& state, const ShapePair& pair) {
  return separation_of(model, pair, state.states[pair.first], state.states[pair.second]);
}

}  // namespace constraint_sim::engine
