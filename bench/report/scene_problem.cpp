#include "scene_problem.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <variant>

#include "constraint_sim/engine/scene.h"
#include "contestant.h"

namespace constraint_sim::report {
namespace {

using engine::BodyId;
using engine::World;

bool has_shape(const engine::Body& body) {
  return !body.no_collision && !std::holds_alternative<engine::Point>(body.shape);
}

/// Returns whether two bodies could touch; shapes and friction matter only then.
bool can_touch(const World& world) {
  int shaped = 0, dynamic = 0;
  for (const BodyId id : world.body_ids()) {
    const engine::Body& body = world.body(id);
    shaped += has_shape(body);
    dynamic += has_shape(body) && body.type == engine::BodyType::kDynamic;
  }
  return shaped >= 2 && dynamic >= 1;
}

void set_shape(const engine::Body& body, Body* made) {
  if (const auto* sphere = std::get_if<engine::Sphere>(&body.shape)) {
    made->shape = Shape::kSphere;
    made->size.x() = sphere->radius;
  } else if (const auto* box = std::get_if<engine::Box>(&body.shape)) {
    made->shape = Shape::kBox;
    made->size = box->size;
  } else {
    made->shape = Shape::kPlane;
  }
  made->friction = body.friction;
  made->restitution = body.restitution;
}

Body made_from(const engine::Body& body, bool with_shape) {
  if (body.type == engine::BodyType::kKinematic) throw Unsupported(body.name + ": is kinematic");
  Body made;
  made.is_static = body.type == engine::BodyType::kStatic;
  if (!made.is_static) made.mass = body.mass;
  made.inertia =
      body.inertia.isZero(0.0) ? body.mass * engine::unit_inertia(body.shape) : body.inertia;
  made.start = {body.state.position, body.state.orientation, body.state.linear_velocity,
                body.state.angular_velocity};
  if (with_shape && has_shape(body)) set_shape(body, &made);
  return made;
}

/// Checks that friction and restitution are equal on all bodies, as a problem requires.
void check_surfaces(const World& world) {
  const engine::Body* first = nullptr;
  for (const BodyId id : world.body_ids()) {
    const engine::Body& body = world.body(id);
    if (!has_shape(body)) continue;
    if (first == nullptr) first = &body;
    if (body.friction != first->friction || body.restitution != first->restitution)
      throw Unsupported(body.name + ": its friction or restitution is not that of " + first->name);
  }
}

std::optional<JointKind> kind_with_axes(engine::JointKind kind) {
  for (int k = static_cast<int>(JointKind::kHinge); k <= static_cast<int>(JointKind::kPointOnPlane);
       ++k)
    if (std::string(name(static_cast<JointKind>(k))) == engine::name(kind))
      return static_cast<JointKind>(k);
  return std::nullopt;
}

/// Returns whether a law has no effect.
bool is_free(const engine::CoordinateLaw& law) {
  return !law.motor && law.stiffness == 0.0 && law.damping == 0.0 && law.friction == 0.0 &&
         std::isinf(law.lower) && std::isinf(law.upper);
}

Joint made_from(const World& world, engine::JointId id, const std::map<BodyId, int>& index) {
  const engine::Joint& joint = world.joint(id);
  const engine::Motor& motor = joint.motor;
  const auto refuse = [&](const char* what) { throw Unsupported(joint.name + ": " + what); };
  if (joint.break_force > 0.0 || world.joint_state(id).broken) refuse("breaks");
  if (motor.amplitude != 0.0 || motor.timeout != 0.0) refuse("its motor changes with time");
  if (joint.collide_connected) refuse("its bodies collide");
  Joint made;
  made.a = index.at(joint.body_a);
  made.b = index.at(joint.body_b);
  made.anchor_a = joint.anchor_a;
  made.anchor_b = joint.anchor_b;
  made.rate = motor.bias;
  made.max_force = motor.max_force;
  for (int i = 0; i < engine::info(joint.kind).coordinates; ++i)
    if (!is_free(joint.coordinates[static_cast<std::size_t>(i)]))
      refuse("has a law on a free coordinate");
  if (joint.kind == engine::JointKind::kBall) {
    made.kind = JointKind::kBall;
  } else if (const std::optional<JointKind> kind = kind_with_axes(joint.kind)) {
    made.kind = *kind;
    made.frame_a = joint.frame_a;
    made.frame_b = *joint.frame_b;
  } else if (const auto* distance = engine::if_distance(joint)) {
    if (distance->is_limited()) refuse("has limits");
    if (distance->damping > 0.0) refuse("is damped");
    made.kind = distance->is_soft() ? JointKind::kSpring : JointKind::kRod;
    made.length = distance->length.value_or(-1.0);
    made.stiffness = distance->stiffness;
  } else {
    refuse("is of a type that only this engine has here");
  }
  return made;
}

void add_forces(const World& world, const std::map<BodyId, int>& index, Problem* problem) {
  for (const engine::Wrench& wrench : world.wrenches()) {
    if (wrench.start > 0.0 || std::isfinite(wrench.end) || !wrench.torque.isZero(0.0))
      throw Unsupported("wrenches: has one that is not a constant force");
    problem->bodies[static_cast<std::size_t>(index.at(wrench.body))].force += wrench.force;
  }
}

/// Returns whether the motion stays in the x-z plane through the first body.
bool is_planar(const Problem& problem) {
  if (problem.gravity.y() != 0.0 || problem.bodies.empty()) return false;
  const double y = problem.bodies.front().start.position.y();
  const auto turns_in_plane = [](const State& state) {
    return state.orientation.x() == 0.0 && state.orientation.z() == 0.0 &&
           state.angular_velocity.x() == 0.0 && state.angular_velocity.z() == 0.0;
  };
  return std::all_of(problem.bodies.begin(), problem.bodies.end(),
                     [&](const Body& body) {
                       return body.start.position.y() == y && body.start.velocity.y() == 0.0 &&
                              body.force.y() == 0.0 && turns_in_plane(body.start);
                     }) &&
         std::all_of(problem.joints.begin(), problem.joints.end(), [&](const Joint& joint) {
           return !has_axes(joint.kind) && joint.anchor_a.y() == (joint.a == kWorld ? y : 0.0) &&
                  joint.anchor_b.y() == (joint.b == kWorld ? y : 0.0);
         });
}

}  // namespace

Problem problem_from_scene(const std::string& path, double duration, double sample) {
  const World world = engine::load_scene_file(path);
  Problem problem;
  problem.name = path;
  problem.group = "scene";
  problem.gravity = world.options().gravity;
  problem.duration = duration;
  problem.sample = sample;
  const bool with_shapes = can_touch(world);
  if (with_shapes) check_surfaces(world);
  std::map<BodyId, int> index{{engine::kWorldBody, kWorld}};
  for (const BodyId id : world.body_ids()) {
    index[id] = static_cast<int>(problem.bodies.size());
    problem.bodies.push_back(made_from(world.body(id), with_shapes));
  }
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    if (with_shapes && joint.body_a != engine::kWorldBody && joint.body_b != engine::kWorldBody &&
        has_shape(world.body(joint.body_a)) && has_shape(world.body(joint.body_b)))
      throw Unsupported(joint.name + ": joins two bodies with shapes that must not touch");
    problem.joints.push_back(made_from(world, id, index));
  }
  add_forces(world, index, &problem);
  problem.is_planar = is_planar(problem);
  return problem;
}

}  // namespace constraint_sim::report
