// Uses the engine as a package of its own would. Exit status 1 when it does not behave.

#include <cmath>
#include <cstdio>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/world.h"

int main() {
  using namespace constraint_sim::engine;
  // a kilogram on a rod of a metre, let go at the horizontal
  World world = load_scene(
      "bodies: [{name: bob, mass: 1, position: [1, 0, 0]}]\n"
      "constraints: [{name: rod, body_b: bob}]\n");
  const double start = world.energy();
  while (world.time() < 1.0 - 1e-9) world.step();
  const double error = world.report().max_constraint_error;
  const double drift = std::abs(world.energy() - start);
  std::printf("bob at z = %.6f m, rod off by %.1e m, energy by %.1e J\n",
              world.state(world.find_body("bob")).position.z(), error, drift);
  // round-off of metres, and 1 kg at 9.81 m/s² times the tolerance of 1e-8 m, ten times over
  return error <= 1e-12 && drift <= 1e-6 ? 0 : 1;
}
