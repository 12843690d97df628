// Uses the engine as an external package does. Exit status 1 for wrong results.

#include <cmath>
#include <cstdio>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/world.h"

int main() {
  using namespace constraint_sim::engine;
  // A mass of 1 kg on a rod of 1 m, released from the horizontal.
  World world = load_scene(
      "bodies: [{name: bob, mass: 1, position: [1, 0, 0]}]\n"
      "constraints: [{name: rod, body_b: bob}]\n");
  const double start = world.energy();
  while (world.time() < 1.0 - 1e-9) world.step();
  const double error = world.report().joints.max_error;
  const double drift = std::abs(world.energy() - start);
  std::printf("bob at z = %.6f m, rod off by %.1e m, energy by %.1e J\n",
              world.state(world.find_body("bob")).position.z(), error, drift);
  // Bounds: rounding of metres, and ten times 1 kg · 9.81 m/s² times the tolerance of 1e-8 m.
  return error <= 1e-12 && drift <= 1e-6 ? 0 : 1;
}
