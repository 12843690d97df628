#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>
#include <vector>

#include "engine/collision/contact_tolerances.h"
#include "engine/edits/issue_id.h"
#include "engine/model/principal_axes.h"
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

// Largest number of moves of a hull or compound to its centre and axes. Measurements needed two.
constexpr int kMostMoves = 6;

bool is_homogeneous(const Body& body) {
  return body.type == BodyType::kDynamic && body.inertia.isZero(0.0);
}

/// Returns the pose, in a body, of what has a pose in a frame that has a pose in the body.
ShapePose composed(const ShapePose& frame, const ShapePose& pose) {
  return {frame.position + frame.orientation * pose.position,
          (frame.orientation * pose.orientation).normalized()};
}

/// Moves the vertices of a hull to its centre and along its principal axes, and its pose so that
/// the hull keeps its place. Hulls that are thin for their length are moved twice and more, until
/// they are centred as a saved scene has them. False where the hull was centred.
bool centre_hull(Hull* hull, ShapePose* pose) {
  for (int i = 0;; ++i) {
    const ConvexHull& surface = *hull->surface;
    if (surface.is_centred()) return i > 0;
    if (i == kMostMoves) refuse("vertices", "the points lie too close to a plane or line");
    std::vector<Eigen::Vector3d> vertices;
    for (const Eigen::Vector3d& vertex : surface.vertices())
      vertices.emplace_back(surface.axes().transpose() * (vertex - surface.centre()));
    *pose = composed(*pose, {surface.centre(), Eigen::Quaterniond(surface.axes())});
    *hull = Hull(vertices);
  }
}

/// Moves the parts of a homogeneous compound so that its centre of mass is in 0 and its principal
/// axes are the axes of the body, more than once where rounding leaves them off. False where they
/// lay so.
bool centre_parts(Compound::Parts* parts) {
  for (int i = 0;; ++i) {
    const Compound compound(*parts);
    const CompoundMass mass = mass_of(compound);
    const double size = size_of(Shape(compound));
    const PrincipalAxes principal = principal_axes(mass.unit_inertia, kCentred * size * size);
    if (principal.is_along && mass.centre.norm() <= kCentred * size) return i > 0;
    if (i == kMostMoves) refuse("shapes", "the parts lie too far from the body for their size");
    const Eigen::Quaterniond back = Eigen::Quaterniond(principal.axes).conjugate();
    for (ShapePart& part : *parts) part.pose = composed({back * -mass.centre, back}, part.pose);
  }
}

/// Moves a convex shape to its centre and principal axes, and its pose so that the shape keeps its
/// place. False where it was centred.
struct CentreSolid {
  ShapePose* pose;

  bool operator()(Point&) const { return false; }
  bool operator()(Sphere&) const { return false; }
  bool operator()(Box&) const { return false; }
  bool operator()(Plane&) const { return false; }
  bool operator()(Cylinder&) const { return false; }
  bool operator()(Hull& hull) const { return centre_hull(&hull, pose); }
  bool operator()(Capsule&) const { return false; }
  bool operator()(Compound&) const { return false; }  // centre_parts() moves its parts
};

/// Moves hulls and homogeneous compounds to where bodies have them: a hull is centred in its pose,
/// and a compound in its body. A dynamic body without a shape_pose and an inertia has the centre of
/// its hull or compound as its own. Throws std::invalid_argument where a shape then has a pose or
/// size that a body may not have.
void centre_shape(Body* body) {
  if (const auto* compound = std::get_if<Compound>(&body->shape)) {
    Compound::Parts parts = *compound->parts;
    for (ShapePart& part : parts) {
      make_unit(&part.pose.orientation);
      std::visit(CentreSolid{&part.pose}, part.shape);
    }
    if (is_homogeneous(*body)) centre_parts(&parts);
    body->shape = Compound(std::move(parts));
    validate(*body);
    return;
  }
  ShapePose pose = body->shape_pose.value_or(ShapePose{});
  if (!std::visit(CentreSolid{&pose}, body->shape)) return;
  if (!is_homogeneous(*body)) body->shape_pose = pose;
  validate(*body);
}

}  // namespace

BodyId World::add_body(const Body& given) {
  validate(given);
  if (has_body(given.name))
    refuse("name", "there is already a body named " + in_quotes(given.name));
  Body body = given;
  if (auto& pose = body.shape_pose) make_unit(&pose->orientation);
  centre_shape(&body);

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
  if (const auto* compound = std::get_if<Compound>(&changed.shape)) {
    Compound::Parts parts = *compound->parts;
    if (is_homogeneous(changed) && centre_parts(&parts))
      refuse("inertia", "must be given for shapes whose centre is beside the centre of mass");
  }
  const MassProperties mass = mass_properties(changed);
  if (mass.can_turn() != impl_->masses[i].can_turn())
    refuse("inertia", "cannot be given to a point mass, or taken from a body that turns");

  impl_->sleep.wake(i, impl_.get());
  impl_->sleep.wake_around(*impl_, id, impl_.get());
  impl_->bodies[i] = changed;
  impl_->masses[i] = mass;
  for (const std::size_t j : impl_->joints_on(i)) {
    if (info(impl_->joints[j].kind).couples_joints) continue;
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
    for (const std::size_t j : impl_->joints_on(i)) begin_closing(*impl_, j, time(), impl_.get());
  if (impl_->is_movable(i))
    impl_->edits.note_island_of(*impl_, id);
  else
    impl_->edits.note_all();
}

}  // namespace constraint_sim::engine
