#include "engine/islands/motion_bounds.h"

#include <algorithm>

#include "engine/islands/step.h"
#include "engine/math/elementary.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/impulse_method.h"

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

/// Distance from its centre within which rotation moves a shape [m].
struct Reach {
  double distance;
  double operator()(const Point&) const { return 0.0; }
  double operator()(const Sphere&) const { return 0.0; }
  double operator()(const Box& box) const { return 0.5 * box.size.norm(); }
  double operator()(const Plane&) const { return distance; }
  double operator()(const Cylinder& cylinder) const {
    return math::hypot(cylinder.radius, 0.5 * cylinder.length);
  }
  double operator()(const Hull& hull) const { return hull.surface->radius(); }
  double operator()(const Capsule& capsule) const { return 0.5 * capsule.length + capsule.radius; }
};

}  // namespace

bool may_touch(const Body& body) {
  return !body.no_collision && !std::holds_alternative<Point>(body.shape);
}

bool may_collide(const Body& a, const Body& b) {
  return !a.no_collision && !b.no_collision &&
         share_a_group(a.collision_groups, a.collision_mask, b.collision_groups, b.collision_mask);
}

bool collides_with_all(const Body& body) {
  return body.collision_groups == 1 && body.collision_mask == kAllGroups;
}

double thickness(const Shape& shape) { return std::visit(Thickness{}, shape); }

double reach_of(const Body& body, double distance) {
  const double arm = body.shape_pose ? body.shape_pose->position.norm() : 0.0;
  return std::visit(Reach{distance}, body.shape) + arm;
}

double extent(const Body& body) {
  const auto* sphere = std::get_if<Sphere>(&body.shape);
  return reach_of(body, kInfinity) + (sphere != nullptr ? sphere->radius : 0.0);
}

double thinner_of(const Model& model, const std::pair<int, int>& bodies) {
  return std::min(thickness(model.bodies[bodies.first].shape),
                  thickness(model.bodies[bodies.second].shape));
}

ContactTolerances tolerances_of(const Model& model, const State& state,
                                const std::pair<int, int>& bodies) {
  double distance = 0.0;
  for (const int body : {bodies.first, bodies.second})
    if (model.is_movable(to_index(body)))
      distance = std::max(distance, state.states[body].position.norm());
  return ContactTolerances(size_of_contact(model.bodies[bodies.first].shape,
                                           model.bodies[bodies.second].shape, distance));
}

double max_center_displacement(const StepContext& step, const BodyState& now, int body,
                               double duration) {
  const Model& model = step.model;
  const double fall =
      model.is_movable(to_index(body)) ? duration * model.options.gravity.norm() : 0.0;
  const double known = duration * (now.linear_velocity.norm() + fall);
  if (!step.assumed.is_any()) return known;
  return std::max(known, duration / model.options.time_step * step.assumed.of(body));
}

double max_point_displacement(const StepContext& step, const BodyState& now, int body,
                              double duration) {
  const double of_center = max_center_displacement(step, now, body, duration);
  const double turning = now.angular_velocity.norm();
  if (turning == 0.0) return of_center;  // planes reach to infinity
  return of_center + duration * turning * reach_of(step.model.bodies[body]);
}

double max_distance(const StepContext& step, const BodyState& now, int body, double duration) {
  return std::min(
      max_point_displacement(step, now, body, duration),
      max_center_displacement(step, now, body, duration) + reach_of(step.model.bodies[body]));
}

double fall_and_way(const WorldOptions& options, const BodyState& body, double duration) {
  return duration * (body.linear_velocity.norm() + duration * options.gravity.norm());
}

double contact_margin(const StepContext& step, const State& state,
                      const std::pair<int, int>& bodies, double duration) {
  const auto way_of = [&](int body) {
    const BodyState& now = state.states[body];
    return controls_contacts(step.model.options) ? max_point_displacement(step, now, body, duration)
                                                 : fall_and_way(step.model.options, now, duration);
  };
  return std::min(way_of(bodies.first) + way_of(bodies.second),
                  kMarginShare * thinner_of(step.model, bodies));
}

double fast_share(const WorldOptions& options) {
  return controls_contacts(options) ? kMarginShare : kFastShare;
}

Proxy proxy_of(const Model& model, const BodyState& at, int body) {
  const PlacedShape placed(model.bodies[body], at);
  const Body& of = model.bodies[body];
  return {bounds(placed.shape(), placed.state()), body, model.is_movable(to_index(body)),
          of.collision_groups, of.collision_mask};
}

void widen(double margin, Proxy* proxy) {
  proxy->box.min -= Eigen::Vector3d::Constant(margin);
  proxy->box.max += Eigen::Vector3d::Constant(margin);
}

bool is_fast(const StepContext& step, const State& state, const std::pair<int, int>& bodies,
             double duration) {
  const auto [a, b] = bodies;
  return max_point_displacement(step, state.states[a], a, duration) +
             max_point_displacement(step, state.states[b], b, duration) >
         fast_share(step.model.options) * thinner_of(step.model, bodies);
}

Separation separation_of(const Model& model, const State& state,
                         const std::pair<int, int>& bodies) {
  const auto [a, b] = bodies;
  const PlacedShape of_a(model.bodies[a], state.states[a]), of_b(model.bodies[b], state.states[b]);
  return separation(of_a.shape(), of_a.state(), of_b.shape(), of_b.state());
}

}  // namespace constraint_sim::engine
