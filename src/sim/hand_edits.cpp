#include "sim/hand_edits.h"

#include "sim/grip.h"

namespace constraint_sim {
namespace {

constexpr double kPushTime = 0.1;  // simulated time [s]

std::string name_of_fixing(const std::string& body) { return "fixed/" + body; }

}  // namespace

void fix(engine::World* world, const std::string& body) {
  engine::Joint joint;
  joint.name = name_of_fixing(body);
  joint.body_b = world->find_body(body);
  const engine::Body& fixed = world->body(joint.body_b);
  const engine::BodyState& state = world->state(joint.body_b);
  const bool turns = !fixed.inertia.isZero(0.0) || !engine::unit_inertia(fixed.shape).isZero(0.0);
  joint.kind = turns ? engine::JointKind::kWeld : engine::JointKind::kBall;
  joint.anchor_a = state.position;
  if (turns) joint.frame_a = state.orientation;
  joint.collide_connected = true;
  world->add_joint(joint);
}

void release(engine::World* world, const std::string& body) {
  const std::string name = name_of_fixing(body);
  if (world->has_joint(name)) world->remove_joint(world->find_joint(name));
  let_go(world, body);
}

void push(engine::World* world, const std::string& body, const Eigen::Vector3d& by) {
  engine::Wrench wrench;
  wrench.body = world->find_body(body);
  wrench.force = world->body(wrench.body).mass / kPushTime * by;
  wrench.start = world->time();
  wrench.end = wrench.start + kPushTime;
  world->add_wrench(wrench);
}

void join(engine::World* world, const std::string& a, const std::string& b) {
  engine::Joint joint;
  joint.name = "joined/" + a + '/' + b;
  joint.body_a = world->find_body(a);
  joint.body_b = world->find_body(b);
  joint.collide_connected = true;
  world->add_joint(joint);
}

}  // namespace constraint_sim
