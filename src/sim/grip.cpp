#include "sim/grip.h"

#include <algorithm>
#include <array>
#include <map>
#include <stdexcept>
#include <utility>
#include <vector>

#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using engine::BodyId;
using engine::Joint;
using engine::JointId;
using engine::World;

using engine::kPi;
// Distance from the target to the other ends of the springs [m]: so far that the springs stay along
// the axes.
constexpr double kArm = 1000.0;

std::string name_of_spring(const std::string& body, int axis) {
  return kGripPrefix + body + '/' + "xyz"[axis];
}

// Returns a target at which the springs do not exceed their force limit.
Vector3d within_reach(const Vector3d& position, const Vector3d& target) {
  const double omega = 2.0 * kPi * kGripFrequency;
  const double reach = kGripAcceleration / (omega * omega);
  const Vector3d way = target - position;
  const double distance = engine::math::hypot(way.x(), way.y(), way.z());
  return distance <= reach ? target : Vector3d(position + reach / distance * way);
}

}  // namespace

double mass_moved_with(const World& world, BodyId body) {
  std::map<std::uint32_t, std::vector<BodyId>> neighbours;
  const auto connect = [&](BodyId a, BodyId b) {
    for (const BodyId id : {a, b})
      if (id == engine::kWorldBody || world.body(id).type != engine::BodyType::kDynamic) return;
    neighbours[a.value].push_back(b);
    neighbours[b.value].push_back(a);
  };
  for (const JointId id : world.joint_ids()) {
    const Joint& joint = world.joint(id);
    if (joint.enabled && !world.joint_state(id).broken && !engine::info(joint.kind).couples_joints)
      connect(joint.body_a, joint.body_b);
  }
  for (const engine::Contact& contact : world.contacts()) connect(contact.body_a, contact.body_b);

  double mass = 0.0;
  std::vector<BodyId> open = {body};
  std::map<std::uint32_t, bool> is_counted = {{body.value, true}};
  while (!open.empty()) {
    const BodyId at = open.back();
    open.pop_back();
    mass += world.body(at).mass;
    for (const BodyId next : neighbours[at.value])
      if (!std::exchange(is_counted[next.value], true)) open.push_back(next);
  }
  return mass;
}

void drag(World* world, const std::string& body, const Vector3d& target) {
  const BodyId id = world->find_body(body);
  if (id == engine::kWorldBody || world->body(id).type != engine::BodyType::kDynamic)
    throw std::invalid_argument("body: only dynamic bodies can be dragged, got '" + body + "'");
  if (!target.allFinite()) throw std::invalid_argument("target: must be finite numbers");
  const engine::BodyState& state = world->state(id);
  const Vector3d reached = within_reach(state.position, target);
  const double omega = 2.0 * kPi * kGripFrequency;
  const Vector3d& v = state.linear_velocity;
  const double speed = engine::math::hypot(v.x(), v.y(), v.z());
  // Damping over mass [1/s].
  const double damping = std::min(2.0 * omega, kGripAcceleration / std::max(speed, 1e-9));
  if (!is_gripped(*world, body)) {
    const double mass = mass_moved_with(*world, id);
    for (int axis = 0; axis < 3; ++axis)
      if (world->has_joint(name_of_spring(body, axis)))
        throw std::invalid_argument("body: a constraint has the name of a spring of the hand, '" +
                                    name_of_spring(body, axis) + "'");
    for (int axis = 0; axis < 3; ++axis) {
      Joint spring;
      spring.name = name_of_spring(body, axis);
      spring.body_b = id;
      spring.anchor_a = state.position + kArm * Vector3d::Unit(axis);
      spring.collide_connected = true;
      spring.distance.length = (spring.anchor_a - reached).norm();
      spring.distance.stiffness = mass * omega * omega;
      spring.distance.damping = mass * damping;
      world->add_joint(spring);
    }
    return;
  }
  for (int axis = 0; axis < 3; ++axis) {
    const JointId joint = world->find_joint(name_of_spring(body, axis));
    Joint spring = world->joint(joint);
    spring.distance.length = (spring.anchor_a - reached).norm();
    spring.distance.damping = spring.distance.stiffness / (omega * omega) * damping;
    world->set_joint(joint, spring);
  }
}

void let_go(World* world, const std::string& body) {
  for (int axis = 0; axis < 3; ++axis) {
    const std::string name = name_of_spring(body, axis);
    if (world->has_joint(name)) world->remove_joint(world->find_joint(name));
  }
}

bool is_grip(const Joint& joint) { return joint.name.rfind(kGripPrefix, 0) == 0; }

Vector3d gripped_target(const World& world, const std::string& body) {
  Vector3d target;
  for (int axis = 0; axis < 3; ++axis) {
    const Joint& spring = world.joint(world.find_joint(name_of_spring(body, axis)));
    target[axis] = spring.anchor_a[axis] - *spring.distance.length;
  }
  return target;
}

bool is_gripped(const World& world, const std::string& body) {
  return world.has_joint(name_of_spring(body, 0));
}

}  // namespace constraint_sim
