// Steps a world with an edit before each step, for bench/edit_instructions.py to count the cost of
// edits: 1000 pendula, or an arm of seven hinges that a controller drives.
//
// Usage: constraint_sim_edit_costs EDIT STEPS
// EDIT: none, motor, state, break, add or all for pendula; for the arm, or with `limited_` before
// for the arm with limits and friction: arm, arm_forces, arm_servos, arm_rates, arm_wrench or
// arm_wrenches

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "engine/math/numbers.h"
#include "make_scene.h"

namespace {

using namespace constraint_sim::engine;

constexpr int kPendula = 1000;
constexpr int kWarmUp = 20;  // warm-up [steps]

World pendula() {
  WorldOptions options;
  options.time_step = 0.01;
  World world(options);
  for (int i = 0; i < kPendula; ++i) {
    Body bob;
    bob.name = "bob_" + std::to_string(i);
    bob.mass = 1.0;
    bob.state.position = {i + 1.0, 0.0, 0.0};
    Joint rod;
    rod.name = "rod_" + std::to_string(i);
    rod.anchor_a = {static_cast<double>(i), 0.0, 0.0};
    rod.body_b = world.add_body(bob);
    world.add_joint(rod);
  }
  return world;
}

/// Bars of 0.3 m, each hinged to the one before it, about y and z in turn.
World arm(bool is_limited) {
  World world;
  BodyId before = kWorldBody;
  double reach = 0.0;
  for (const double mass : {2.0, 2.0, 1.0, 1.0, 0.5, 0.5, 0.3}) {
    const std::string number = std::to_string(world.joint_ids().size());
    Body bar = make_body("bar_" + number, Box{{0.27, 0.03, 0.03}}, mass, {reach + 0.15, 0.0, 0.0});
    bar.no_collision = true;
    Joint hinge;
    hinge.name = "hinge_" + number;
    hinge.kind = JointKind::kHinge;
    hinge.body_a = before;
    if (before != kWorldBody) hinge.anchor_a = {0.15, 0.0, 0.0};
    hinge.anchor_b = {-0.15, 0.0, 0.0};
    const bool is_about_y = world.joint_ids().size() % 2 == 0;
    if (is_about_y)
      hinge.frame_a =
          Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY());
    CoordinateLaw& law = hinge.coordinates[0];
    law.damping = 0.1;
    if (is_limited) {
      law.lower = -2.5;
      law.upper = 2.5;
      law.friction = 0.01;
    }
    hinge.body_b = before = world.add_body(bar);
    world.add_joint(hinge);
    reach += 0.3;
  }
  return world;
}

/// Sets motor or wrenches of an arm, as a controller does that follows a trajectory.
void command(const std::string& what, World* world) {
  const double t = world->time();
  int number = 0;
  for (const JointId id : world->joint_ids()) {
    Motor motor;
    ++number;
    if (what == "arm_forces") {
      motor.force = 3.0 * std::sin(5.0 * t + number);
    } else if (what == "arm_servos") {
      motor.position = 0.3 * std::sin(t + number);
      motor.servo_stiffness = 20.0;
      motor.servo_damping = 1.0;
    } else if (what == "arm_rates") {
      motor.bias = 0.3 * std::sin(t + number);
    } else {
      continue;
    }
    world->set_motor(id, 0, motor);
  }
  const bool is_constant = what == "arm_wrench";
  if (what != "arm_wrenches" && !(is_constant && world->wrenches().empty())) return;
  std::vector<BodyId> ids;
  world->body_ids(&ids);
  Wrench wrench;
  wrench.body = ids.back();
  wrench.force = {1.0 + (is_constant ? 0.0 : std::sin(t)), 0.5, 0.0};
  wrench.start = t;
  wrench.end = is_constant ? kInfinity : t + world->options().time_step;
  world->add_wrench(wrench);
}

void edit(const std::string& what, int step, World* world) {
  const std::string number = std::to_string(500 + step);
  if (what == "motor") {
    Motor motor;
    motor.bias = 0.01 * (step % 2);
    world->set_motor(world->find_joint("rod_500"), motor);
  } else if (what == "state") {
    const BodyId bob = world->find_body("bob_500");
    world->set_state(bob, world->state(bob));
  } else if (what == "break") {
    world->set_broken(world->find_joint("rod_" + number), true);
  } else if (what == "add") {
    Body bob;
    bob.name = "new_" + number;
    bob.mass = 1.0;
    bob.state.position = {0.0, 5.0 + step, 0.0};
    world->add_body(bob);
  } else if (what == "all") {
    world->set_options(world->options());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: %s EDIT STEPS, see the source\n", argv[0]);
    return 2;
  }
  std::string what = argv[1];
  const bool is_limited = what.rfind("limited_", 0) == 0;
  if (is_limited) what.erase(0, 8);
  const bool is_arm = what.rfind("arm", 0) == 0;
  World world = is_arm ? arm(is_limited) : pendula();
  const int steps = kWarmUp + std::atoi(argv[2]);
  for (int i = 0; i < steps; ++i) {
    if (is_arm)
      command(what, &world);
    else if (i >= kWarmUp)
      edit(what, i - kWarmUp, &world);
    if (world.step().outcome.failed) return 3;
  }
  return 0;
}
