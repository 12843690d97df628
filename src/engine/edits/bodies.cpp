#include <algorithm>
#include <cmath>
#include <variant>
#include <vector>

#include "engine/constraints/joint.h"
#include "engine/edits/find_named.h"
#include "engine/edits/issue_id.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

MassProperties mass_properties(const Body& body) {
  MassProperties mass;
  if (body.type != BodyType::kDynamic) return mass;
  mass.inverse_mass = 1.0 / body.mass;
  mass.weight_share = 1.0 - body.gravity_compensation;
  mass.inertia = body.inertia;
  if (mass.inertia.isZero(0.0)) mass.inertia = body.mass * unit_inertia(body.shape);
  if (!mass.inertia.isZero(0.0)) mass.inverse_inertia = mass.inertia.cwiseInverse();
  return mass;
}

/// Moves the vertices of a hull to its centre and along its principal axes, where shapes are. Its
/// place in the body stays; without a shape_pose and an inertia a dynamic body has its own centre
/// there. Hulls that are thin for their length are moved twice and more, until they are centred as
/// a saved scene has them. Throws std::invalid_argument where the hull then has a pose or size that
/// a body may not have.
void centre_hull(Body* body) {
  if (!std::holds_alternative<Hull>(body->shape)) return;
  const bool is_homogeneous = body->type == BodyType::kDynamic && body->inertia.isZero(0.0);
  constexpr int kMostMoves = 6;  // measured: 2
  for (int i = 0;; ++i) {
    const ConvexHull& surface = *std::get<Hull>(body->shape).surface;
    if (surface.is_centred()) return i == 0 ? void() : validate(*body);
    if (i == kMostMoves) refuse("vertices", "the points lie too close to a plane or line");
    const ShapePose moved{surface.centre(), Eigen::Quaterniond(surface.axes())};
    std::vector<Eigen::Vector3d> vertices;
    for (const Eigen::Vector3d& vertex : surface.vertices())
      vertices.emplace_back(surface.axes().transpose() * (vertex - surface.centre()));
    body->shape = Hull(vertices);
    if (is_homogeneous) continue;
    const ShapePose pose = body->shape_pose.value_or(ShapePose{});
    body->shape_pose = ShapePose{pose.position + pose.orientation * moved.position,
                                 (pose.orientation * moved.orientation).normalized()};
  }
}

}  // namespace

BodyId World::add_body(const Body& given) {
  validate(given);
  if (has_body(given.name))
    refuse("name", "there is already a body named " + in_quotes(given.name));
  Body body = given;
  if (auto& pose = body.shape_pose) make_unit(&pose->orientation);
  centre_hull(&body);

  const BodyId id = issue(&impl_->next_body_id);
  impl_->bodies.push_back(body);
  make_unit(&impl_->bodies.back().state.orientation);
  impl_->states.push_back(impl_->bodies.back().state);
  impl_->masses.push_back(mass_properties(body));
  impl_->body_ids.push_back(id);
  impl_->corrections.push_back(Twist::Zero());
  impl_->asleep.push_back(false);
  if (body.type != BodyType::kDynamic)
    impl_->sleep.wake_all(impl_.get());  // an immovable body may overlap sleeping bodies
  impl_->body_by_name.emplace(body.name, id);
  impl_->edits.note_topology();
  return id;
}

bool World::has_body(std::string_view name) const {
  return impl_->body_by_name.count(std::string(name)) > 0;
}

BodyId World::find_body(std::string_view name) const {
  return find_named(impl_->body_by_name, name, "body");
}

std::vector<BodyId> World::body_ids() const {
  return {impl_->body_ids.begin() + 1, impl_->body_ids.end()};
}
void World::body_ids(std::vector<BodyId>* ids) const {
  ids->assign(impl_->body_ids.begin() + 1, impl_->body_ids.end());
}

void World::set_body(BodyId id, const Body& body) {
  const std::size_t i = impl_->index(id);
  if (id == kWorldBody) refuse("name", "'world' cannot be changed");
  Body changed = impl_->bodies[i];
  if (body.name != changed.name) refuse("name", "cannot be changed");
  if (body.type != changed.type) refuse("type", "cannot be changed");
  changed.mass = body.mass;
  changed.inertia = body.inertia;
  changed.friction = body.friction;
  changed.restitution = body.restitution;
  changed.no_collision = body.no_collision;
  changed.collision_groups = body.collision_groups;
  changed.collision_mask = body.collision_mask;
  changed.gravity_compensation = body.gravity_compensation;
  validate(changed);
  const MassProperties mass = mass_properties(changed);
  if (mass.can_turn() != impl_->masses[i].can_turn())
    refuse("inertia", "cannot be given to a point mass, or taken from a body that turns");

  impl_->sleep.wake(i, impl_.get());
  impl_->sleep.wake_around(*impl_, id, impl_.get());
  impl_->bodies[i] = changed;
  impl_->masses[i] = mass;
  for (const std::size_t j : impl_->joints_on(i)) {
    if (couples_joints(impl_->joints[j].kind)) continue;
    const auto [a, b] = ends_of(*impl_, impl_->joints[j]);
    impl_->joint_states[j].radius =
        std::max(impl_->masses[a].radius_of_gyration(), impl_->masses[b].radius_of_gyration());
  }
  if (!impl_->is_movable(i)) return impl_->edits.note_all();
  impl_->edits.note_mass_of(*impl_, id);
}

void World::set_state(BodyId id, const BodyState& state) {
  const std::size_t i = impl_->index(id);
  if (id == kWorldBody) refuse("name", "'world' cannot be moved");
  Body body = impl_->bodies[i];
  body.state = state;
  validate(body);
  BodyState placed = state;
  make_unit(&placed.orientation);

  if (impl_->is_movable(i))
    impl_->sleep.wake(i, impl_.get());
  else
    impl_->sleep.wake_all(impl_.get());
  // Joints on an immovable body that keeps its pose, and gets another twist, go on closing.
  const bool stays = !impl_->is_movable(i) && impl_->states[i].position == placed.position &&
                     impl_->states[i].orientation.coeffs() == placed.orientation.coeffs();
  impl_->states[i] = placed;
  impl_->corrections[i].setZero();
  if (!stays)
    for (const std::size_t j : impl_->joints_on(i)) open_joint(*impl_, j, time(), impl_.get());
  if (impl_->is_movable(i))
    impl_->edits.note_island_of(*impl_, id);
  else
    impl_->edits.note_all();
}

}  // namespace constraint_sim::engine
