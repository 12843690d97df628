// Steps a world of 1000 pendula with an edit before each step, for bench/edit_instructions.py to
// count the cost of edits.
//
// Usage: constraint_sim_edit_costs EDIT STEPS     EDIT: none, motor, state, break, add or all

#include <cstdio>
#include <cstdlib>
#include <string>

#include "constraint_sim/engine/world.h"

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
    std::fprintf(stderr, "usage: %s none|motor|state|break|add|all STEPS\n", argv[0]);
    return 2;
  }
  World world = pendula();
  for (int i = 0; i < kWarmUp; ++i) world.step();
  const int steps = std::atoi(argv[2]);
  for (int i = 0; i < steps; ++i) {
    edit(argv[1], i, &world);
    if (world.step().failed) return 3;
  }
  return 0;
}
